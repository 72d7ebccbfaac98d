"""What is deployed: checked as text, and its commands run here as they stand."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack
from importlib import metadata
from pathlib import Path
from typing import Any

import click
import pytest
import yaml
from dask_cluster import free_port
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from project import ROOT
from requirements import EXTRAS, SLIM
from running import RunningService
from warm_start import WarmProcess, start_warm

from modalmotion.cli.commands import main
from modalmotion_service.settings import Settings

DEPLOY = ROOT / "deploy"
CLUSTER = ("scheduler", "worker")
IMAGE = {"platform_machine": "x86_64", "sys_platform": "linux", "platform_system": "Linux"}


def compose() -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
    return loaded


def dockerfile() -> str:
    return (ROOT / "Dockerfile").read_text()


def default_command() -> list[str]:
    return list(yaml.safe_load(dockerfile().rpartition("\nCMD ")[2]))


def test_every_container_is_hardened_and_of_one_image() -> None:
    services = compose()["services"]
    assert set(services) == {"modalmotion", *CLUSTER}
    for name, service in services.items():
        assert service["image"] == f"modalmotion:{version()}", name
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        temporary = [place for place in service["tmpfs"] if place.startswith("/tmp:")]  # noqa: S108
        assert [place.partition(":")[2] for place in temporary] == ["size=64m,mode=1777"]
        assert service["init"] is True
        # Neither the log nor processes without end.
        assert {"max-size", "max-file"} <= set(service["logging"]["options"])
        assert service["pids_limit"] >= 1024
        assert service["mem_limit"] == "${MODALMOTION_MEMORY_LIMIT:-8g}"
        assert service["restart"] == "unless-stopped"


def version() -> str:
    found = re.search(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert found is not None
    return found[1]


def test_the_scheduler_is_reached_by_nobody_else() -> None:
    document = compose()
    for name in CLUSTER:
        service = document["services"][name]
        assert service["profiles"] == ["cluster"]
        assert service["networks"] == ["cluster"]
        assert "ports" not in service
    assert document["networks"]["cluster"]["internal"] is True


def test_workers_share_the_services_volume_and_are_two() -> None:
    services = compose()["services"]
    assert services["worker"]["volumes"] == services["modalmotion"]["volumes"]
    assert services["worker"]["deploy"]["replicas"] == 2


def test_the_service_has_time_to_drain() -> None:
    seconds = int(compose()["services"]["modalmotion"]["stop_grace_period"].rstrip("s"))
    assert seconds > 2 * Settings().drain_seconds


def test_the_image_names_its_bases_versions_and_ends_as_a_plain_user() -> None:
    text = dockerfile()
    bases = re.findall(r"^FROM (\S+)", text, re.MULTILINE)
    assert len(set(bases)) == 1
    tag = bases[0].partition(":")[2]
    assert tag not in ("", "latest")
    # The constraints hold for the Python that the tests run on.
    assert tag.startswith(f"{sys.version_info[0]}.{sys.version_info[1]}-")
    last = text.rpartition("FROM ")[2]
    assert "USER modalmotion" in last
    assert not re.search(
        r"^(ADD|SHELL|MAINTAINER)\b|sudo|apt-get|curl |chmod 777", text, re.MULTILINE
    )
    assert all("--no-cache-dir" in line for line in text.splitlines() if "pip install" in line)
    instructions = re.findall(
        r"^(CMD|HEALTHCHECK|ENTRYPOINT)\b(.*(?:\n.*CMD.*)?)", last, re.MULTILINE
    )
    assert sorted(name for name, _ in instructions) == ["CMD", "HEALTHCHECK"]
    assert all("[" in rest for _, rest in instructions)


def test_the_image_has_every_extra_that_its_commands_need() -> None:
    wanted = {"service", "cluster", "plot", "images", "dicom", "oidc", "telemetry"}
    assert wanted <= set(EXTRAS)
    assert installed_for(needed_by(EXTRAS)) == set(pinned("requirements.txt"))
    assert installed_for(needed_by(SLIM)) == set(pinned("requirements-slim.txt"))


def needed_by(extras: tuple[str, ...]) -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    optional = project["optional-dependencies"]
    return [*project["dependencies"], *(one for extra in extras for one in optional[extra])]


def installed_for(requirements: list[str]) -> set[str]:
    """Names of all that these need, by what is installed here, as on the image's machine."""
    names: set[str] = set()
    waiting = [(Requirement(one), "") for one in requirements]
    while waiting:
        one, extra = waiting.pop()
        if one.marker is not None and not one.marker.evaluate({**IMAGE, "extra": extra}):
            continue
        name = canonicalize_name(one.name)
        if name in names and not one.extras:
            continue
        names.add(name)
        needed = [Requirement(text) for text in metadata.requires(name) or []]
        waiting += [(other, extra) for other in needed for extra in ("", *one.extras)]
    return names


def pinned(name: str) -> dict[str, str]:
    """Versions by the names of packages; each has the hash of a file."""
    text = (ROOT / name).read_text().replace("\\\n", " ")
    versions: dict[str, str] = {}
    for line in text.splitlines():
        if not line.startswith("#"):
            requirement, *hashes = line.split()
            assert hashes
            assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", one) for one in hashes), line
            package, version = requirement.split("==")
            versions[canonicalize_name(package)] = version
    return versions


def test_the_image_has_the_versions_that_the_tests_run_with_by_their_hashes() -> None:
    lines = (ROOT / "constraints.txt").read_text().split()
    constraints = {
        str(canonicalize_name(name)): one for name, one in (x.split("==") for x in lines)
    }
    for file in ("requirements.txt", "requirements-slim.txt", "requirements-build.txt"):
        for name, version in pinned(file).items():
            assert constraints[name] == version, f"{name}: run tools/requirements.py"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for one in project["build-system"]["requires"]:
        assert canonicalize_name(one) in pinned("requirements-build.txt")
    installs = re.findall(r"pip (?:install|wheel) (.+?)(?: \\\n|\n)", dockerfile())
    assert len(installs) == 4
    for options in installs:
        # Nothing else comes from anywhere.
        assert ("--require-hashes" in options) != ("--no-index --no-deps" in options), options


def test_the_backup_of_the_timer_is_a_command_on_the_services_folder() -> None:
    text = (DEPLOY / "modalmotion-backup.service").read_text()
    start = re.search(r"^ExecStart=\S+/modalmotion (.+)$", text, re.MULTILINE)
    assert start is not None
    group, command, source, target = start[1].split()
    store = main.get_command(click.Context(main), group)
    assert isinstance(store, click.Group)
    assert command in store.commands
    served = re.search(r"MODALMOTION_DATA_DIR=(\S+)", (DEPLOY / "modalmotion.service").read_text())
    assert served is not None
    assert source == served[1]
    writable = re.search(r"^ReadWritePaths=(.+)$", text, re.MULTILINE)
    assert writable is not None
    for path in (source, target):
        assert any(path.startswith(f"{folder}/") for folder in writable[1].split())
    assert (DEPLOY / "modalmotion-backup.timer").is_file()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
@pytest.mark.parametrize("name", sorted(path.name for path in DEPLOY.glob("*.service")))
def test_units_are_sandboxed(name: str) -> None:
    found = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", DEPLOY / name],
        capture_output=True,
        text=True,
        check=False,
    )
    # 0 is a locked room, 10 an open one.
    level = re.search(r"exposure level for \S+: ([0-9.]+)", found.stdout)
    assert level is not None, found.stderr
    assert float(level[1]) <= 2.0
    assert (found.returncode, found.stderr) == (0, "")


def test_the_proxy_passes_what_the_service_would_take() -> None:
    text = (ROOT / "deploy" / "nginx.conf").read_text()
    code = "\n".join(line.partition("#")[0] for line in text.splitlines())
    # Every statement ends, every block closes, before the one around it does.
    depth = 0
    for sign in re.findall(r"[{}]", code):
        depth += 1 if sign == "{" else -1
        assert depth >= 0
    assert depth == 0
    for line in filter(None, map(str.strip, code.splitlines())):
        # A quoted text may go on in the next line.
        assert line[-1] in ";{}'", line
    settings = Settings()
    megabytes = re.search(r"client_max_body_size (\d+)m;", code)
    assert megabytes is not None
    assert int(megabytes[1]) * 2**20 > settings.max_image_body_bytes
    patience = re.search(r"proxy_read_timeout (\d+)s;", code)
    assert patience is not None
    assert int(patience[1]) > max(settings.wait_seconds, settings.task_seconds)
    for needed in (
        "ssl_protocols TLSv1.2 TLSv1.3;",
        "keepalive_timeout 3s;",
        "proxy_request_buffering off;",
        "proxy_buffering off;",
        "proxy_set_header Host $host;",
        "proxy_set_header X-Forwarded-Proto https;",
        "server 127.0.0.1:8000;",
        # The log's format has neither path nor query, and errors of lesser levels are not logged.
        "access_log /var/log/nginx/modalmotion.log modalmotion;",
        "error_log /var/log/nginx/modalmotion-error.log emerg;",
    ):
        assert needed in code
    for told in ("$request ", "$request_uri", "$uri", "$args", "$query_string", "$http_"):
        assert told not in code.partition("log_format")[2].partition(";")[0]


@pytest.mark.parametrize("name", ["modalmotion.service", "modalmotion-worker@.service"])
def test_units_start_commands_that_exist(name: str) -> None:
    text = (ROOT / "deploy" / name).read_text()
    assert re.search(r"^Restart=always$", text, re.MULTILINE)
    assert re.search(r"^User=modalmotion$", text, re.MULTILINE)
    # Started again whatever happens, but never on the empty folder under a missing mount.
    assert "StartLimitIntervalSec=0" in text
    assert "RequiresMountsFor=/var/lib/modalmotion" in text
    assert "KillMode=mixed" in text
    # One process without memory is not the end of the others.
    assert "MemoryMax=80%\nOOMPolicy=continue\n" in text
    if name == "modalmotion.service":
        # Behind the proxy everybody comes over loopback.
        assert "MODALMOTION_REQUIRE_KEYS=true" in text
    start = re.search(r"^ExecStart=\S+/(modalmotion|dask) (\S+)", text, re.MULTILINE)
    assert start is not None
    if start[1] == "dask":
        found = pytest.importorskip("distributed.cli.dask_worker").main
    else:
        found = main.get_command(click.Context(main), start[2])
    assert found is not None
    options = {
        option
        for parameter in found.params
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    command = text.partition("ExecStart=")[2].partition("\n")[0]
    assert options >= set(re.findall(r"--[a-z-]+", command))


def manifests() -> list[dict[str, Any]]:
    return list(yaml.safe_load_all((DEPLOY / "kubernetes.yaml").read_text()))


def test_pods_run_the_image_as_its_own_user_with_probes_and_limits() -> None:
    pods = {
        (one["kind"], one["metadata"]["name"]): one["spec"]["template"]["spec"]
        for one in manifests()
        if "template" in one.get("spec", {})
    }
    assert set(pods) == {("StatefulSet", "modalmotion"), ("Deployment", "modalmotion-stateless")}
    user = re.search(r"--uid (\d+)", dockerfile())
    assert user is not None
    for pod in pods.values():
        assert pod["securityContext"]["runAsUser"] == int(user[1])
        assert pod["securityContext"]["runAsNonRoot"] is True
        # Else variables of the cluster look like settings of ours.
        assert pod["enableServiceLinks"] is False
        assert pod["terminationGracePeriodSeconds"] > 2 * Settings().drain_seconds
        (container,) = pod["containers"]
        assert container["image"] == f"modalmotion:{version()}"
        assert container["securityContext"]["readOnlyRootFilesystem"] is True
        assert container["resources"]["limits"]["memory"]
        paths = {
            container[probe]["httpGet"]["path"] for probe in ("readinessProbe", "livenessProbe")
        }
        assert paths == {"/health/ready", "/health/live"}
        options = [word.partition("=")[0] for word in container.get("command", ["", "serve"])[2:]]
        known = main.get_command(click.Context(main), "serve")
        assert known is not None
        assert {one for parameter in known.params for one in parameter.opts} >= set(options)


def test_the_manifests_name_settings_and_volumes_that_exist() -> None:
    names = {f"MODALMOTION_{name.upper()}" for name in Settings.model_fields}
    for one in manifests():
        if one["kind"] == "ConfigMap":
            assert names >= one["data"].keys()
            assert all(isinstance(value, str) for value in one["data"].values())
        pod = one.get("spec", {}).get("template", {}).get("spec")
        if pod is None:
            continue
        volumes = {volume["name"] for volume in pod.get("volumes", ())}
        volumes |= {
            each["metadata"]["name"] for each in one["spec"].get("volumeClaimTemplates", ())
        }
        for container in pod["containers"]:
            assert names >= {variable["name"] for variable in container.get("env", ())}
            assert volumes == {mount["name"] for mount in container["volumeMounts"]}


def test_the_manifests_are_valid_to_kubernetes() -> None:
    validate = pytest.importorskip("kubernetes_validate").validate
    for one in manifests():
        validate(one, "1.30", strict=True)


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.mark.thorough
def test_the_commands_of_the_compose_file_are_a_working_cluster(
    tmp_path: Path, processes: ExitStack, beat: bytes
) -> None:
    """The containers' own command lines, as processes here, with a folder for the volume."""
    port, here = free_port(), "127.0.0.1"
    service = RunningService(tmp_path / "unused")
    service.log = tmp_path / "service.log"
    service.port = free_port()

    def native(command: list[str]) -> list[str]:
        """The same command for this machine: names of containers and free ports aside."""
        there = {"scheduler": here, "0.0.0.0": here, "8786": str(port), "8000": str(service.port)}  # noqa: S104
        program, *rest = command[1:] if command[0] == "python" else ["-m", *command]
        assert program == "-m"
        renamed = (word.replace("//scheduler:8786", f"//{here}:{port}") for word in rest)
        return [there.get(word, word) for word in renamed]

    def start(kind: str, command: list[str], **settings: str) -> WarmProcess:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", **settings}
        sink = processes.enter_context((tmp_path / "service.log").open("ab"))
        process = start_warm(
            kind, *native(command), environment=environment, folder=tmp_path, sink=sink
        )
        processes.callback(process.wait, 60)
        processes.callback(process.terminate)
        return process

    document = compose()["services"]
    start("cluster", document["scheduler"]["command"])
    for _ in range(document["worker"]["deploy"]["replicas"]):
        start("cluster", document["worker"]["command"])
    data_dir = re.search(r"MODALMOTION_DATA_DIR=(\S+)", dockerfile())
    assert data_dir is not None
    assert [*document["modalmotion"]["environment"]] == [
        "MODALMOTION_ENGINE",
        "MODALMOTION_SCHEDULER",
    ]
    folder = tmp_path / data_dir[1].lstrip("/")
    settings = {
        "MODALMOTION_ENGINE": "dask",
        "MODALMOTION_SCHEDULER": f"tcp://{here}:{port}",
        "MODALMOTION_DATA_DIR": str(folder),
        "MODALMOTION_WAIT_SECONDS": "120",
    }
    server = start("server", default_command(), **settings)
    check = [str(word) for word in yaml.safe_load(health_check())]
    check[2] = check[2].replace(":8000", f":{service.port}")
    for _ in range(600):
        if subprocess.run([sys.executable, *check[1:]], capture_output=True).returncode == 0:
            break
        assert server.poll() is None, service.log.read_text()[-3000:]
        time.sleep(0.2)
    answer = service.request("POST", "/v1/sequences", beat, timeout=150)
    assert answer.status == 201, answer.body
    link = answer.json["links"]["self"]
    assert service.request("GET", f"{link}/signature", timeout=150).status == 200
    assert len(list((folder / "signatures").rglob("*.h5"))) == 1


def health_check() -> str:
    found = re.search(r"^HEALTHCHECK.*\\\n\s+CMD (.+)$", dockerfile(), re.MULTILINE)
    assert found is not None
    return found[1]
