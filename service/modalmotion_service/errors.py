"""Errors that only a service has."""

from __future__ import annotations

from modalmotion.errors import ModalMotionError


class SlowClientError(ModalMotionError):
    """A request's body comes too slowly."""

    code = "request_too_slow"


class BusyError(ModalMotionError):
    """Too many requests or jobs are under way."""

    code = "busy"


class CostError(ModalMotionError):
    """Work costs many times what an honest file of its size does."""

    code = "too_costly"


class NeedsStoreError(ModalMotionError):
    """The call needs a store, and this service has none."""

    code = "needs_store"


class ConflictError(ModalMotionError):
    """The state of a resource does not allow this now."""

    code = "conflict"


class AuthenticationError(ModalMotionError):
    """The key is missing or not valid.

    Attributes
    ----------
    key_id : str or None
        Of a key that is no longer active, for the audit log; the answer does not show it.
    """

    code = "unauthenticated"
    key_id: str | None = None


class ForbiddenError(ModalMotionError):
    """The sender is known, but may not do this."""

    code = "forbidden"


class ProviderError(ModalMotionError):
    """The identity provider does not answer."""

    code = "login_unavailable"


class RateLimitedError(ModalMotionError):
    """Too many requests within a minute."""

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


class NoWorkerError(ClusterError):
    """No worker process is ready to work."""

    code = "no_worker"
