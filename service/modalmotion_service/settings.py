"""Settings, read from the environment (MODALMOTION_...); errors name the variables."""

import os
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, PositiveFloat, PositiveInt, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from modalmotion import errors, formats


class Settings(BaseSettings):
    """Settings of an operator; `/v1/limits` publishes the limits."""

    model_config = SettingsConfigDict(env_prefix="MODALMOTION_", frozen=True)

    data_dir: Path = Path("modalmotion-data")
    """Folder of the results."""
    keep_uploads: bool = True
    """Whether uploaded vertices are stored."""
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    """Lowest level that is logged; requests are logged as info."""
    telemetry: bool = False
    """Whether traces are sent, without any id, to the collector that OTEL_EXPORTER_OTLP_ENDPOINT
    names."""
    reserve_bytes: int = Field(100_000_000, ge=0)
    """Uploads are refused while less is free on the disk."""
    max_owner_bytes: int = Field(0, ge=0)
    """Largest size of one owner's store in bytes; more is answered 507. 0: no limit."""
    workers: int = Field(default_factory=lambda: os.cpu_count() or 1, ge=1, le=256)
    """Processes; one more does short work alone."""
    engine: str = "processes"
    """What does the work: processes of this machine; dask, for the workers of `scheduler`; or
    another entry point modalmotion.engines."""
    scheduler: str | None = None
    """Dask scheduler of the engine dask, such as tcp://host:8786."""
    cluster_seconds: float = Field(30.0, gt=0, le=3600)
    """How long the start waits for the scheduler and its first worker."""
    wait_seconds: float = Field(20.0, ge=0, le=600)
    """How long a request waits before it becomes a job."""
    drain_seconds: float = Field(20.0, ge=0, le=600)
    """How long jobs under way may finish at shutdown."""

    require_keys: bool = False
    """Whether requests over loopback need a key too, as behind a reverse proxy; those over any
    other address always do."""
    first_key_file: Path | None = None
    """File, such as a secret of a container, whose first line is the first key (mm_, 16 hexadecimal
    digits, _, 43 letters of base64url); none: one is made and shown."""
    trusted_proxies: str = "127.0.0.1"
    """Addresses and networks, separated by commas, of proxies whose X-Forwarded-For and
    X-Forwarded-Proto are believed."""
    path_prefix: str = Field("", pattern=r"^(/[A-Za-z0-9._~-]+)*$")
    """Path, such as /motion, under which a proxy serves the service."""
    cors_origins: tuple[str, ...] = ()
    """Origins whose pages may call the service with a key, as JSON such as
    ["https://viewer.example"]."""
    oidc_issuer: str | None = None
    """Issuer whose logins (OpenID Connect) are accepted beside keys."""
    oidc_audience: str | None = None
    """Audience that tokens of this issuer must be for."""
    oidc_scope_prefix: str = "modalmotion:"
    """Of our scopes in tokens: modalmotion:read opens what read does."""
    oidc_roles: dict[str, str] = {}
    """Scopes that roles and groups of tokens open, as JSON such as {"cardiology": "read,write"}."""
    oidc_name_claim: str | None = None
    """Claim of tokens, such as preferred_username, that the audit log names people by; none: by a
    digest."""
    oidc_owner_claim: str = Field("sub", min_length=1)
    """Claim of tokens that says whose store they open; another one than sub lets those who share
    its value share a store."""
    stateless: bool = False
    """Whether nothing is kept: any of several such services may answer any request."""
    read_only_dir: Path | None = None
    """Data folder, or a backup of one, whose keys, owners, models and templates a service that
    keeps nothing serves; it is only read."""
    audit_stream: str | None = None
    """Where entries of the audit log go as lines too: stdout, stderr, syslog, syslog://host:port,
    or the path of a file or a pipe; none: nowhere, and to stdout where nothing is kept."""
    audit_form: Literal["json", "fhir"] = "json"
    """Form of these lines; fhir is AuditEvent of FHIR R4."""
    audit_days: float = Field(0.0, ge=0, le=1e5)
    """How long entries stay in the data folder; 0: for good."""
    max_requests_per_minute: PositiveInt = 6_000
    """Requests a minute with one key; more are answered 429."""
    max_anonymous_per_minute: PositiveInt = 600
    """The same from one address without a key; health checks pass."""
    max_failures_per_minute: PositiveInt = 30
    """Answers 401 a minute to one address; then 429."""

    result_hours: float = Field(168.0, gt=0, le=1e6)
    """How long the file of a job is kept after the job's end."""
    job_days: float = Field(90.0, gt=0, le=1e5)
    """How long a finished job and an idempotency key are known."""

    retry_hours: float = Field(72.0, gt=0, le=1e5)
    """How long a job is tried again where a full disk or a lost store stops it."""

    max_body_bytes: PositiveInt = 256_000_000
    """Largest request body."""
    max_json_bytes: PositiveInt = 16_000_000
    """Largest body of a request that is not an upload."""
    max_frames: PositiveInt = 10_000
    """Most frames in a sequence."""
    max_vertices: PositiveInt = 2_000_000
    """Most vertices in a frame."""
    max_faces: PositiveInt = 4_000_000
    """Most triangles in a mesh."""
    max_decompressed_bytes: PositiveInt = 1_000_000_000
    """Largest total of the arrays in an upload."""
    max_image_body_bytes: PositiveInt = 1_000_000_000
    """Largest request body of images."""
    max_image_bytes: PositiveInt = 2_000_000_000
    """Largest total of the samples of images."""
    image_hours: float = Field(168.0, gt=0, le=1e6)
    """How long images wait to be tracked; those kept on purpose stay."""
    max_query_ids: PositiveInt = 1_000
    """Most signatures in one answer."""
    max_batch_files: PositiveInt = 1_000
    """Most files in one form."""
    max_concurrent_requests: PositiveInt = 64
    """Requests under way at once; more are answered 429."""
    max_connections: PositiveInt = 1_000
    """Open connections; the one that is idle longest goes for one more."""
    max_unfinished_jobs: PositiveInt = 1_000
    """Jobs queued or running at once; more are answered 429."""
    header_seconds: PositiveFloat = 10.0
    """Time for a request's headers to arrive; then it is closed."""
    idle_seconds: PositiveFloat = 10.0
    """Longest pause within a request's body; then 408."""
    upload_seconds: PositiveFloat = 300.0
    """Time for a request's whole body; then 408."""
    max_training_sequences: PositiveInt = 100_000
    """Most sequences that a model is trained on."""
    training_seconds: PositiveFloat = 3600.0
    """Longest time of a training, once its signatures are there."""
    task_seconds: PositiveFloat = 300.0
    """Longest time of one piece of work."""
    task_cost_factor: float = Field(20.0, ge=1)
    """Most processor time of one piece of work, in multiples of what an honest file of its size
    takes."""
    task_cost_seconds: PositiveFloat = 2.0
    """Processor time that every piece of work may take."""
    task_memory_bytes: int = Field(6_000_000_000, ge=1_000_000_000)
    """Address space of one piece of work."""

    @field_validator(
        "scheduler",
        "audit_stream",
        "oidc_issuer",
        "oidc_audience",
        "oidc_name_claim",
        mode="before",
    )
    @classmethod
    def _none_if_empty(cls, value: object) -> object:
        # As a compose file passes on a variable that is not set.
        return value or None

    @property
    def max_concurrent_requests_of_owner(self) -> int:
        """Of requests under way at once, those with keys of one owner: three of four."""
        return self.max_concurrent_requests - self.max_concurrent_requests // 4

    @property
    def read_limits(self) -> formats.ReadLimits:
        """Limits that every reader of uploads applies."""
        return formats.ReadLimits(
            frames=self.max_frames,
            vertices=self.max_vertices,
            faces=self.max_faces,
            decompressed_bytes=self.max_decompressed_bytes,
        )

    @property
    def limits(self) -> dict[str, float]:
        """All limits on clients, by the names in errors."""
        limits: dict[str, float] = {
            name.removeprefix("max_"): getattr(self, name)
            for name in (*type(self).model_fields, "max_concurrent_requests_of_owner")
            if (name.startswith("max_") or name in _OF_WORK)
            and name not in ("max_owner_bytes", "max_connections")
        }
        return limits


_OF_WORK: Final = (
    *("header_seconds", "idle_seconds", "upload_seconds", "task_seconds", "training_seconds"),
    *("task_cost_factor", "task_cost_seconds", "task_memory_bytes"),
)
_PREFIX: Final = "MODALMOTION_"

# A cluster that runs a service of this name sets these for everything in it.
_OF_OTHERS: Final = re.compile(r"(SERVICE|PORT)(_.*)?")


def read_settings(**stated: Any) -> Settings:
    """Read the settings.

    Parameters
    ----------
    **stated
        By name; they go over the environment.

    Raises
    ------
    ParameterError
        If a value is not valid for its setting; all of them are named.
    """
    try:
        return Settings(**stated)
    except ValidationError as error:
        faults = [
            f"{_PREFIX}{str(fault['loc'][0]).upper()} is {fault['input']!r}: {fault['msg']}."
            for fault in error.errors()
        ]
        raise errors.ParameterError(
            " ".join(faults), remedy="docs/service.md lists the settings with their defaults."
        ) from error


def unknown_variables(environment: Mapping[str, str] = os.environ) -> Iterator[tuple[str, str]]:
    """Give variables that look like settings but are not, each with the nearest setting.

    A setting that is misspelt has its default: a service that should demand keys may not.
    """
    known = [name.upper() for name in Settings.model_fields]
    for name in sorted(environment):
        end = name.upper().removeprefix(_PREFIX)
        if end == name.upper() or end in known or _OF_OTHERS.fullmatch(end):
            continue
        yield name, "".join(f"{_PREFIX}{match}" for match in get_close_matches(end, known, n=1))
