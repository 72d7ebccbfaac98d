"""A requests session whose requests go to an app in this process."""

from __future__ import annotations

import io
from typing import Any

import requests
from fastapi.testclient import TestClient
from requests.adapters import BaseAdapter
from requests.structures import CaseInsensitiveDict
from urllib3 import HTTPResponse


class _ToTheApp(BaseAdapter):
    def __init__(self, client: TestClient) -> None:
        super().__init__()
        self.client = client

    def send(
        self,
        request: requests.PreparedRequest,
        stream: bool = False,
        timeout: Any = None,
        verify: Any = True,
        cert: Any = None,
        proxies: Any = None,
    ) -> requests.Response:
        body: Any = request.body
        content = body.encode() if isinstance(body, str) else body
        if hasattr(content, "read"):
            content = content.read()
        headers = {
            name.encode(): value if isinstance(value, bytes) else value.encode("latin-1", "replace")
            for name, value in request.headers.items()
        }
        answer = self.client.request(
            request.method or "", request.url or "", content=content, headers=headers
        )
        response = requests.Response()
        response.status_code = answer.status_code
        response.headers = CaseInsensitiveDict(answer.headers)
        response.request, response.url = request, request.url or ""
        response.encoding = answer.encoding
        response.reason = answer.reason_phrase
        response.raw = HTTPResponse(
            io.BytesIO(answer.content),
            headers=dict(answer.headers),
            status=answer.status_code,
            preload_content=False,
        )
        return response

    def close(self) -> None:
        pass


def session_of(client: TestClient) -> requests.Session:
    session = requests.Session()
    session.mount("http://", _ToTheApp(client))
    session.trust_env = False
    return session
