"""Errors that only a service has, each with the status of its answer."""

from modalmotion.errors import ModalMotionError


class ServiceError(ModalMotionError):
    """What only a service says of a request.

    Attributes
    ----------
    status : int
        Of its answer.
    """

    status = 500


class SlowClientError(ServiceError):
    """A request's body comes too slowly."""

    code = "request_too_slow"
    status = 408


class BusyError(ServiceError):
    """Too many requests or jobs are under way."""

    code = "busy"
    status = 429


class CostError(ServiceError):
    """Work costs many times what an honest file of its size does."""

    code = "too_costly"
    status = 422


class NeedsStoreError(ServiceError):
    """The call needs a store, and this service has none."""

    code = "needs_store"
    status = 501


class ConflictError(ServiceError):
    """The state of a resource does not allow this now."""

    code = "conflict"
    status = 409


class AuthenticationError(ServiceError):
    """The key is missing or not valid.

    Attributes
    ----------
    key_id : str or None
        Of a key that is no longer active, for the audit log; the answer does not show it.
    """

    code = "unauthenticated"
    status = 401
    key_id: str | None = None


class ForbiddenError(ServiceError):
    """The sender is known, but may not do this."""

    code = "forbidden"
    status = 403


class ProviderError(ServiceError):
    """The identity provider does not answer."""

    code = "login_unavailable"
    status = 503


class RateLimitedError(ServiceError):
    """Too many requests within a minute."""

    code = "rate_limited"
    status = 429


class IdempotencyMismatchError(ServiceError):
    """An idempotency key was used before, with another request."""

    code = "idempotency_mismatch"
    status = 422


class WorkerDiedError(ServiceError):
    """A worker process ended in the middle of a task, more than once."""

    code = "worker_died"
    status = 422


class ClusterError(ServiceError):
    """The machines that work is sent to cannot be used now."""

    code = "cluster_unavailable"
    status = 503


class NoWorkerError(ClusterError):
    """No worker process is ready to work."""

    code = "no_worker"
