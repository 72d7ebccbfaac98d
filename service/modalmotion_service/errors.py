"""Errors that only a service has."""

from __future__ import annotations

from modalmotion.errors import ModalMotionError


class SlowClientError(ModalMotionError):
    """A request's body comes too slowly."""

    code = "request_too_slow"


class BusyError(ModalMotionError):
    """As much is under way as is done at once."""

    code = "busy"


class ConflictError(ModalMotionError):
    """The state of a resource does not allow this now."""

    code = "conflict"


class AuthenticationError(ModalMotionError):
    """No key came, or none that is valid.

    Attributes
    ----------
    key_id : str or None
        Of a key that was one, for the audit log; the answer does not tell it.
    """

    code = "unauthenticated"
    key_id: str | None = None


class ForbiddenError(ModalMotionError):
    """Whoever asks is known, and may not do this."""

    code = "forbidden"


class RateLimitedError(ModalMotionError):
    """More requests came than may in that time."""

    code = "rate_limited"


class IdempotencyMismatchError(ModalMotionError):
    """An idempotency key was used before, with another request."""

    code = "idempotency_mismatch"


class WorkerDiedError(ModalMotionError):
    """A worker process ended in the middle of a task, more than once."""

    code = "worker_died"


class ClusterError(ModalMotionError):
    """The machines that work is sent to cannot be used now."""

    code = "cluster_unavailable"
