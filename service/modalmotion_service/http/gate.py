"""The gate that every request passes: authentication, permission, rate limits, the audit log.

Pure ASGI and before anything reads a body: the body of a refused request is never received.
"""

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Connection

from modalmotion.errors import ModalMotionError
from modalmotion.mesh import NAMES
from modalmotion_service.access import scopes
from modalmotion_service.access.audit import BEGUN, AuditLog, Event
from modalmotion_service.access.keys import Authenticator, key_required
from modalmotion_service.access.logins import Logins, is_login
from modalmotion_service.access.rates import Rates, comes_by_loopback, require_same_site
from modalmotion_service.errors import AuthenticationError, ForbiddenError, RateLimitedError
from modalmotion_service.http.problems import problem_of

CLIENT_GONE: Final = 499
"""Status in logs and metrics where a client leaves before its request is complete."""

_IDS: Final = "modalmotion.ids"
_FACTS: Final = "modalmotion.mesh"
_ROUTE: Final = "modalmotion.route"
_ENDED_KEY: Final = "modalmotion.ended_key"

_DIGEST: Final = re.compile(r"[0-9a-f]{32}|[0-9a-f]{64}")
_NAME: Final = re.compile(r"[A-Za-z0-9._-]{1,100}")

# Routes that need one of these scopes change something.
_CHANGES: Final = (scopes.Scope.WRITE, scopes.Scope.TRAIN)


@dataclass(frozen=True)
class Access:
    """Open keys and audit log, as the gate needs them.

    Parameters
    ----------
    keys : Authenticator
    audit : AuditLog
    """

    keys: Authenticator
    audit: AuditLog


def note_ids(connection: HTTPConnection, ids: list[str]) -> None:
    """Name in the audit log what a request is about, where its path does not."""
    connection.scope.setdefault(_IDS, []).extend(ids)


def note_facts(connection: HTTPConnection, names: Sequence[str]) -> None:
    """Name in the audit log which facts a request changed, without their values."""
    connection.scope[_FACTS] = [f"facts.{name}" for name in names if name in NAMES]


def route_of(connection: Connection) -> str | None:
    """Template of the route that a request was checked by; None if there is none."""
    template: str | None = connection.get(_ROUTE)
    return template


async def require_gate(connection: HTTPConnection) -> None:
    """Refuse a route that the gate has not checked: one that the table of scopes does not name.

    Raises
    ------
    ForbiddenError
        If another route is taken than the one that was checked.
    """
    if getattr(connection.scope.get("route"), "path", None) != route_of(connection.scope):
        raise ForbiddenError(
            "No scope is stated for this route, so nobody may ask.",
            remedy="Report it: the table of scopes must name every route.",
        )


class Gate:
    """ASGI middleware; the app's state contains an `Access` once its lifespan has begun.

    Parameters
    ----------
    app : ASGIApp
    require_keys : bool
        Whether requests over loopback need a key too.
    rates : Rates
    logins : Logins, optional
        Of an organisation, beside keys.
    """

    def __init__(
        self, app: ASGIApp, require_keys: bool, rates: Rates, logins: Logins | None = None
    ) -> None:
        self.app = app
        self.logins = logins
        self.require_keys = require_keys
        self.rates = rates

    async def __call__(self, scope: Connection, receive: Receive, send: Send) -> None:
        """Pass the request on if it may pass, and log its outcome."""
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        target = scopes.target_of(scope["method"], scope["path"])
        scope[_ROUTE] = None if target is None else target.template
        headers: dict[str, str] = {}
        refused: ModalMotionError | None = None
        try:
            headers = await self._admit(connection, target)
        except ModalMotionError as error:
            refused = error
        is_noted = not isinstance(refused, RateLimitedError) and (
            refused is not None
            or (target is not None and target.scope not in (None, scopes.Scope.METRICS))
        )
        started = withheld = False

        async def sent(message: Message) -> None:
            nonlocal started, withheld
            if withheld:
                return
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                started = True
                if is_noted:
                    try:
                        await self._note(connection, target, message["status"], answer)
                    except ModalMotionError as error:
                        # An answer that cannot be logged is not sent.
                        withheld = True
                        await problem_of(error)(scope, receive, send)
                        return
                for name, value in headers.items():
                    answer[name] = value
            await send(message)

        if refused is not None:
            await problem_of(refused)(scope, receive, sent)
            return
        if target is not None and target.scope in _CHANGES:
            # Before the change: whatever happens then, the log names who began what.
            try:
                await self._note(connection, target, BEGUN, Headers())
            except ModalMotionError as error:
                await problem_of(error)(scope, receive, send)
                return
        try:
            await self.app(scope, receive, sent)
        except BaseException as error:
            # Failed, or given up by the client: something may have been done all the same.
            if is_noted and not started:
                status = CLIENT_GONE if isinstance(error, ClientDisconnect) else 500
                # Where it cannot be logged either, what went wrong first is answered.
                with contextlib.suppress(ModalMotionError):
                    await self._note(connection, target, status, Headers())
            raise

    async def _admit(
        self, connection: HTTPConnection, target: scopes.Target | None
    ) -> dict[str, str]:
        scope = connection.scope
        needs_key = self.require_keys or not comes_by_loopback(scope)
        client = "" if connection.client is None else connection.client.host
        if target is not None and target.scope is None:
            if not needs_key or target.template.startswith(scopes.PROBES):
                return {}
            return self.rates.address(client)
        try:
            principal, headers = await self._recognise(connection, needs_key)
        except AuthenticationError as error:
            scope[_ENDED_KEY] = error.key_id
            self.rates.failure(client)
            raise
        scopes.attach(scope, principal)
        if target is not None and target.scope not in principal.scopes:
            raise ForbiddenError(
                f"This key lacks the scope {target.scope}.",
                remedy=f"Use a key with the scope {target.scope}; "
                "`modalmotion keys list` shows what each has. The scopes of a login are its "
                "issuer's to give.",
                details={"scope": str(target.scope)},
            )
        return headers

    async def _recognise(
        self, connection: HTTPConnection, needs_key: bool
    ) -> tuple[scopes.Principal, dict[str, str]]:
        token = _token(connection.headers)
        if token is None:
            if needs_key:
                raise key_required()
            require_same_site(connection.scope)
            return scopes.LOCAL_PRINCIPAL, {}
        if self.logins is not None and is_login(token):
            principal = await self.logins.principal(token)
        else:
            access: Access = connection.app.state.access
            principal = access.keys.authenticate(token).principal
        return principal, self.rates.key(principal.key_id or "")

    async def _note(
        self, connection: HTTPConnection, target: scopes.Target | None, status: int, answer: Headers
    ) -> None:
        principal = scopes.principal_of(connection.scope)
        access: Access = connection.app.state.access
        event = Event(
            request_id=connection.scope.get("modalmotion.request_id", ""),
            owner=None if principal is None else principal.owner,
            key_id=connection.scope.get(_ENDED_KEY) if principal is None else principal.key_id,
            client="" if connection.client is None else connection.client.host,
            method=connection.scope["method"],
            route="" if target is None else target.template,
            ids=" ".join(_ids(connection, target, answer)),
            status=status,
        )
        await access.audit.note(event)


def _token(headers: Headers) -> str | None:
    authorization = headers.get("authorization")
    if authorization is None:
        return headers.get("x-api-key")
    scheme, _, token = authorization.partition(" ")
    # Another scheme is a wrong key: whoever sends one means to be recognised.
    return token.strip() if scheme.lower() == "bearer" else ""


def _ids(connection: HTTPConnection, target: scopes.Target | None, answer: Headers) -> list[str]:
    """List what a request is about: ids alone, never what a person may have written."""
    ids = []
    if target is not None:
        for name, value in target.path_parameters.items():
            pattern = _DIGEST if name.endswith("_id") else _NAME
            if pattern.fullmatch(value):
                ids.append(value)
    new_id = answer.get("location", "").rpartition("/")[2]
    query = QueryParams(connection.scope.get("query_string", b""))
    named = [*connection.scope.get(_IDS, ()), query.get("template", ""), new_id]
    named = list(filter(_DIGEST.fullmatch, named))
    return list(dict.fromkeys([*ids, *named, *connection.scope.get(_FACTS, ())]))
