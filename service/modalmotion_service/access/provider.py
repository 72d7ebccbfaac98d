"""An identity provider's signing keys: discovered, fetched, and fetched again when they change."""

from __future__ import annotations

import asyncio
import json
import threading
import time
import urllib.request
from collections.abc import Callable
from concurrent.futures import Future
from http.client import HTTPException
from typing import Any, Final
from urllib.parse import urlsplit

from modalmotion.errors import ParameterError
from modalmotion_service.access.site import is_loopback
from modalmotion_service.errors import ProviderError

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
    if parts.scheme == "http" and is_loopback(host):
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
