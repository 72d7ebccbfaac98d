"""An issuer of tokens on this machine: discovery, keys that rotate, and signatures."""

from __future__ import annotations

import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


class IdentityProvider:
    """Serves keys on a loopback address and signs with any of them."""

    def __init__(self) -> None:
        self.keys: dict[str, Any] = {}
        self.published: dict[str, dict[str, Any]] = {}
        self.requests: list[str] = []
        self.is_down = False
        self.seconds_between_bytes = 0.0
        self.nesting = 0
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.requests.append(self.path)
                pages = {
                    "/.well-known/openid-configuration": {
                        "issuer": outer.stated,
                        "jwks_uri": outer.keys_at,
                    },
                    "/keys": {"keys": list(outer.published.values())},
                }
                body = json.dumps(pages.get(self.path, {})).encode()
                body = b"[" * outer.nesting + body + b"]" * outer.nesting
                self.send_response(503 if outer.is_down else 200)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                for start in range(0, len(body), 1 if outer.seconds_between_bytes else len(body)):
                    end = start + (1 if outer.seconds_between_bytes else len(body))
                    self.wfile.write(body[start:end])
                    time.sleep(outer.seconds_between_bytes)

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.issuer = f"http://127.0.0.1:{self._server.server_port}"
        self.stated = self.issuer
        self.keys_at = f"{self.issuer}/keys"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def rotate(self, key_id: str, kind: str = "RSA", n_bits: int = 2048) -> None:
        """Publish a new key, and no other one."""
        import jwt
        from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa

        if kind == "RSA":
            own: Any = rsa.generate_private_key(public_exponent=65537, key_size=n_bits)
            algorithm: Any = jwt.algorithms.RSAAlgorithm
        elif kind == "EC":
            own, algorithm = ec.generate_private_key(ec.SECP256R1()), jwt.algorithms.ECAlgorithm
        else:
            own, algorithm = ed25519.Ed25519PrivateKey.generate(), jwt.algorithms.OKPAlgorithm
        self.keys[key_id] = own
        described = json.loads(algorithm.to_jwk(own.public_key()))
        self.published = {key_id: {**described, "kid": key_id, "use": "sig"}}

    def token(
        self, key_id: str, *, algorithm: str = "RS256", key: Any = None, **claims: Any
    ) -> str:
        """Sign claims; None leaves one out."""
        import jwt

        now = int(time.time())
        stated = {
            "iss": self.issuer,
            "aud": "modalmotion",
            "sub": "jane.doe@hospital.example",
            "iat": now,
            "exp": now + 300,
            "scope": "openid modalmotion:read modalmotion:write",
            **claims,
        }
        whole = {name: value for name, value in stated.items() if value is not None}
        signing = self.keys.get(key_id) if key is None else key
        token: str = jwt.encode(whole, signing, algorithm=algorithm, headers={"kid": key_id})
        return token

    def sign(self, key_id: str, data: bytes) -> bytes:
        """Sign bytes, as RS256 does."""
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import padding

        signature: bytes = self.keys[key_id].sign(data, padding.PKCS1v15(), hashes.SHA256())
        return signature
