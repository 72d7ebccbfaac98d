"""Logins of an organisation beside keys: tokens of OpenID Connect, and whoever signs them."""

import asyncio
import hashlib
import json
import re
import threading
import time
import urllib.request
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from http.client import HTTPException
from typing import Any, Final
from urllib.parse import urlsplit

from modalmotion.errors import ParameterError, needs_extra
from modalmotion_service.access import rates, scopes
from modalmotion_service.errors import AuthenticationError, ProviderError
from modalmotion_service.settings import Settings

REFRESH_SECONDS: Final = 600.0
"""Age from which keys are fetched again: one that the provider has withdrawn is of no use then."""

_BETWEEN_SECONDS: Final = 10.0
"""Between two attempts: tokens that name unknown keys cost the provider nothing more."""

_STALE_SECONDS: Final = 86_400.0
"""Age up to which keys are used while the provider does not answer."""

# For discovery and keys together: whoever logs in waits for them.
_TIMEOUT: Final = 5.0
_MOST_BYTES: Final = 1_000_000
_DISCOVERY: Final = "/.well-known/openid-configuration"

Fetch = Callable[[str], bytes]


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """Redirects are errors: whoever redirects is not who was named."""

    def redirect_request(self, *_: Any) -> None:
        """Follow none."""


_opener: Final = urllib.request.build_opener(_NoRedirects, urllib.request.ProxyHandler())


class Provider:
    """Signing keys of an issuer, by their ids.

    Parameters
    ----------
    issuer : str
        As tokens name it.
    fetch : function, optional
        Gets an address.
    clock : function, optional
        Seconds that only grow.

    Raises
    ------
    ParameterError
        If the issuer is no address that can be trusted: https, or http on this machine.
    """

    def __init__(
        self,
        issuer: str,
        fetch: Fetch | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        _require_safe(issuer)
        self.issuer = issuer
        self._fetch = _get if fetch is None else fetch
        self._clock = clock
        self._keys: dict[str, dict[str, Any]] = {}
        self._fetched = self._tried = -float("inf")
        self._fetching = asyncio.Lock()
        self._asked: Future[dict[str, dict[str, Any]] | None] | None = None

    async def key(self, key_id: str) -> dict[str, Any] | None:
        """Find a key by its id, fetched where it is not known; None if there is none.

        Raises
        ------
        ProviderError
            If the provider does not answer, and nothing recent is known.
        """
        if self._is_due(key_id):
            async with self._fetching:
                # Others have fetched them meanwhile.
                if self._is_due(key_id):
                    await self._refresh()
        if self._clock() - self._fetched > _STALE_SECONDS:
            raise ProviderError(
                "The identity provider does not answer, so logins cannot be checked.",
                remedy="Try again soon, or use a key; an operator should look after "
                "MODALMOTION_OIDC_ISSUER.",
                details={"retry_after_seconds": int(_BETWEEN_SECONDS)},
            )
        return self._keys.get(key_id)

    def _is_due(self, key_id: str) -> bool:
        now = self._clock()
        is_wanted = key_id not in self._keys or now - self._fetched > REFRESH_SECONDS
        return is_wanted and now - self._tried > _BETWEEN_SECONDS

    async def _refresh(self) -> None:
        if self._asked is None:
            self._asked = Future()
            # By itself: one that does not end keeps neither other work nor the service's end.
            threading.Thread(target=self._ask, args=[self._asked], daemon=True).start()
        asked = self._asked
        try:
            # What comes later than this is there for the next attempt.
            keys = await asyncio.wait_for(asyncio.wrap_future(asked), _TIMEOUT)
        except TimeoutError:
            keys = None
        finally:
            if asked.done():
                self._asked = None
            # At the end: whoever comes meanwhile waits for it.
            self._tried = self._clock()
        # Where there are none, those that are known serve on for a while.
        if keys is not None:
            self._keys, self._fetched = keys, self._clock()

    def _ask(self, asked: Future[dict[str, dict[str, Any]] | None]) -> None:
        # It cannot be cancelled then.
        asked.set_running_or_notify_cancel()
        keys = None
        try:
            keys = self._keys_of_issuer()
        except RecursionError:
            # What nests without end names no key.
            keys = {}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, HTTPException):
            keys = None
        finally:
            asked.set_result(keys)

    def _keys_of_issuer(self) -> dict[str, dict[str, Any]]:
        about = json.loads(self._fetch(self.issuer.rstrip("/") + _DISCOVERY))
        if about["issuer"] != self.issuer:
            raise ValueError("another issuer")
        address = str(about["jwks_uri"])
        _require_safe(address)
        listed = json.loads(self._fetch(address))["keys"]
        return {
            str(one["kid"]): dict(one)
            for one in listed
            # Symmetric keys would let whoever reads them sign.
            if "kid" in one and one.get("kty") != "oct" and one.get("use", "sig") == "sig"
        }


def _require_safe(address: str) -> None:
    parts = urlsplit(address)
    host = parts.hostname or ""
    if parts.scheme == "https" and host:
        return
    if parts.scheme == "http" and rates.is_loopback(host):
        return
    raise ParameterError(
        f"{address[:200]!r} is no address of an identity provider.",
        remedy="State MODALMOTION_OIDC_ISSUER as https://..., letter by letter as tokens name it.",
    )


def _get(address: str) -> bytes:
    with _opener.open(address, timeout=_TIMEOUT) as answer:
        data: bytes = answer.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError("too long")
    return data


# Asymmetric ones alone: neither `none`, nor a secret that the service would have to hold.
_ALGORITHMS: Final = (
    *("RS256", "RS384", "RS512", "PS256", "PS384", "PS512"),
    *("ES256", "ES384", "EdDSA"),
)

# By errors of PyJWT.
_FAULTS: Final = {
    "ExpiredSignatureError": "has expired",
    "ImmatureSignatureError": "is not valid yet",
    "InvalidIssuedAtError": "is not valid yet",
    "InvalidAudienceError": "is for another service",
    "InvalidIssuerError": "is of another issuer",
}

# Of RSA, as NIST SP 800-131A asks.
_FEWEST_BITS: Final = 2048

_TOKEN: Final = re.compile(r"[A-Za-z0-9_-]{1,4000}\.[A-Za-z0-9_-]{1,16000}\.[A-Za-z0-9_-]{0,4000}")
_LONGEST_KEY_ID: Final = 256
_NAME: Final = re.compile(r"[\w.@+-]{1,100}", re.ASCII)
_LEEWAY_SECONDS: Final = 60
"""By which clocks may differ."""

_REMEDY: Final = "Log in again, and send the access token as `Authorization: Bearer TOKEN`."


class Logins:
    """Checks tokens and says whose they are.

    Parameters
    ----------
    provider : Provider
    settings : Settings

    Raises
    ------
    MissingExtraError
        If PyJWT is absent.
    ParameterError
        If a role opens what is no scope.
    """

    def __init__(self, provider: Provider, settings: Settings) -> None:
        with needs_extra("oidc"):
            import cryptography  # noqa: F401 (without it PyJWT has no such algorithms)
            import jwt

        self._jwt = jwt
        self._provider = provider
        self._settings = settings
        roles = settings.oidc_roles.items()
        self._roles = {role: _scopes_of(role, words) for role, words in roles}

    async def principal(self, token: str) -> scopes.Principal:
        """Check a token.

        Raises
        ------
        AuthenticationError
            If it is not signed by the issuer, not for this service, or not valid now.
        ProviderError
            If the issuer's keys cannot be fetched.
        """
        try:
            head = self._jwt.get_unverified_header(token)
        except (self._jwt.PyJWTError, RecursionError):
            raise _refused("does not read") from None
        key_id, algorithm = head.get("kid"), head.get("alg")
        if algorithm not in _ALGORITHMS:
            raise _refused("is signed in a way that is not accepted")
        if not isinstance(key_id, str) or len(key_id) > _LONGEST_KEY_ID:
            raise _refused("names no key")
        described = await self._provider.key(key_id)
        if described is None:
            raise _refused("is signed with a key that its issuer does not have")
        return self._principal(self._claims(token, described, algorithm))

    def _claims(self, token: str, described: Mapping[str, Any], algorithm: str) -> dict[str, Any]:
        jwt = self._jwt
        try:
            # Of the key's own kind: a key of RSA checks no curve.
            key = jwt.PyJWK(dict(described), algorithm=algorithm)
            if described.get("kty") == "RSA" and key.key.key_size < _FEWEST_BITS:
                raise _refused(f"is signed with a key of less than {_FEWEST_BITS} bits")
            claims: dict[str, Any] = jwt.decode(
                token,
                key,
                algorithms=[algorithm],
                audience=self._settings.oidc_audience,
                issuer=self._provider.issuer,
                leeway=_LEEWAY_SECONDS,
                options={"require": ["exp", "iss", "aud", "sub"]},
            )
        except (jwt.PyJWTError, RecursionError) as error:
            raise _refused(_FAULTS.get(type(error).__name__, "is not valid")) from None
        return claims

    def _principal(self, claims: Mapping[str, Any]) -> scopes.Principal:
        claim, of_name = self._settings.oidc_owner_claim, self._settings.oidc_name_claim
        who = claims.get(claim)
        if not isinstance(who, str) or not who:
            raise _refused(f"has no claim {claim}")
        # A name of a folder that tells nothing of the person, and is nobody's of another issuer.
        owner = f"oidc-{_digest(self._provider.issuer, claim, who)[:40]}"
        key_id = f"oidc-{_digest(self._provider.issuer, str(claims['sub']))[:16]}"
        name = claims.get(of_name) if of_name else None
        if isinstance(name, str) and _NAME.fullmatch(name):
            key_id = f"{key_id}:{name}"
        return scopes.Principal(owner, key_id, self._scopes(claims))

    def _scopes(self, claims: Mapping[str, Any]) -> frozenset[scopes.Scope]:
        # RFC 8693 has one text of words in `scope`; others a list, or call it `scp`. Roles and
        # groups are lists of RFC 9068; Keycloak has its roles in `realm_access`.
        stated = [word for name in ("scope", "scp") for word in _words(claims.get(name))]
        realm = claims.get("realm_access")
        held = [word for name in ("roles", "groups") for word in _words(claims.get(name))]
        held += _words(realm.get("roles")) if isinstance(realm, Mapping) else []
        prefix = self._settings.oidc_scope_prefix
        named = {word.removeprefix(prefix) for word in stated + held if word.startswith(prefix)}
        by_role = frozenset[scopes.Scope]().union(*(self._roles.get(word, ()) for word in held))
        return by_role | {scope for scope in scopes.Scope if str(scope) in named}


def logins_of(settings: Settings) -> Logins | None:
    """Make the logins that settings name; None if they name no issuer.

    Raises
    ------
    ParameterError
        If an issuer is named without an audience, or is no address.
    MissingExtraError
        If PyJWT is absent.
    """
    if settings.oidc_issuer is None:
        return None
    if settings.oidc_audience is None:
        raise ParameterError(
            "MODALMOTION_OIDC_ISSUER is set without MODALMOTION_OIDC_AUDIENCE.",
            remedy="State the audience of this service's tokens: those for other services of the "
            "same issuer must not open it.",
        )
    return Logins(Provider(settings.oidc_issuer), settings)


def is_login(token: str) -> bool:
    """Return whether this looks like a token, and not like a key."""
    return _TOKEN.fullmatch(token) is not None


def _words(value: object) -> list[str]:
    words = value.split() if isinstance(value, str) else value
    return [word for word in words if isinstance(word, str)] if isinstance(words, list) else []


def _scopes_of(role: str, words: str) -> frozenset[scopes.Scope]:
    try:
        return frozenset(scopes.Scope(word.strip()) for word in words.split(","))
    except ValueError:
        raise ParameterError(
            f"MODALMOTION_OIDC_ROLES gives the role {role[:80]!r} the scopes {words[:80]!r}.",
            remedy=f"Scopes are {', '.join(scopes.Scope)}, separated by commas.",
        ) from None


def _refused(why: str) -> AuthenticationError:
    return AuthenticationError(f"This login {why}.", remedy=_REMEDY)


def _digest(*parts: str) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()
