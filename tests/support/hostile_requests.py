"""Requests as bytes on the wire, made to break a server: deterministic by their number."""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from urllib.parse import quote

from modalmotion_service.access.scopes import SCOPE_OF

ROUTES = sorted(SCOPE_OF)
METHODS = ["GET", "POST", "PATCH", "DELETE", "PUT", "HEAD", "OPTIONS", "TRACE"]
ODD_METHODS = ["", "get", "G\x00T", "A" * 5000, "GET /", "CONNECT"]
TEXTS = [
    *("", " ", "..", "../../../etc/passwd", "..%2f..%2f", "%00", "%ff%fe", "%", "%zz", "~", "*"),
    *("'", "' OR '1'='1", "1; DROP TABLE sequences", "<script>", "{sequence_id}", "null", "None"),
    *("\u202e", "\U0001f9e0", "é", "\ud800", "a" * 300, "a" * 20_000, "\t", "\r\nX: y", "0x41"),
]
NUMBERS = [
    *("0", "-1", "-0", "1e309", "-1e309", "nan", "inf", "1e-400", "0.1", "1_000", "٣", "1" * 400),
    *("9223372036854775808", "-9223372036854775809", "4294967296", "+1", " 7", "7.0", "0b1"),
]
QUERIES = [
    *("modes", "reference", "topology", "grid", "template", "apex", "base", "theta_zero", "to"),
    *("wave_speed", "weights", "limit", "cursor", "subject", "label", "state", "owner", "rms"),
    *("max_error", "bytes", "effort", "format", "unit", "times", "frame_interval", "n_vertices"),
    *("dtype", "animation", "first", "stop", "closed", "max_targets", "components", "nonsense"),
]
CURSORS = ["AAAA", "====", "MTIz", "fg", "_" * 199, quote("é")]
HEADERS = [
    *("Accept", "Prefer", "If-None-Match", "Idempotency-Key", "X-Request-ID", "Content-Type"),
    *("Range", "Expect", "Content-Encoding", "Accept-Encoding", "Cookie", "Origin", "Upgrade"),
    *("X-Forwarded-For", "X-Forwarded-Proto", "Forwarded", "Connection", "TE", "X-API-Key"),
    *("Sec-Fetch-Site", "If-Match", "Authorization", "Host", "Content-Length", "Odd Name", ""),
]
VALUES = [
    *(b"", b"*", b"*/*;q=", b";;;,,q=", b"\xff\xfe\x00", b"\x00", b"a" * 9000, b'W/"', b'"' * 50),
    *(b"wait=99999999999", b"respond-async, wait=-1", b"wait=\xd9\xa3", b"bytes=0-0,5-2", b"1e9"),
    *(b"application/json", b"multipart/form-data", b"multipart/form-data; boundary=", b"-1"),
    *(b"multipart/form-data; boundary=x", b"text/plain; charset=utf-7", b"gzip", b"100-continue"),
    *(b"Bearer", b"Bearer mm_", b"Basic Og==", b"websocket", b"[::1", b"evil.example", b"0"),
    *(b"application/json; charset=utf-16", b"99999999999999999999", b"chunked", b"0x10", b"+5"),
]


def hostile_request(rng: random.Random, ids: Mapping[str, str], token: str, npz: bytes) -> bytes:
    """Make one request: mostly well-formed, wrong in one or several places."""
    method, path = rng.choice(ROUTES)
    if rng.random() < 0.1:
        method = rng.choice(METHODS if rng.random() < 0.8 else ODD_METHODS)
    for name, known in ids.items():
        path = path.replace(f"{{{name}}}", _id(rng, known))
    if rng.random() < 0.08:
        path += rng.choice(["/", "//", "/..", "?", "#x", ";a=b", "%2f", "/" + rng.choice(TEXTS)])
    target = path if rng.random() < 0.9 else rng.choice(TEXTS)
    pairs = [
        f"{rng.choice(QUERIES)}={_quoted(rng, _value(rng, ids))}"
        for _ in range(rng.choice([0, 0, 1, 1, 2, 5]))
    ]
    if pairs:
        target += "?" + "&".join(pairs)
    body = (
        _body(rng, ids, npz)
        if rng.random() < (0.9 if method in ("POST", "PATCH") else 0.1)
        else b""
    )
    lines = [f"{method} {target} HTTP/1.1".encode("utf-8", "surrogatepass")]
    lines += [b"Host: 127.0.0.1", b"Connection: close"]
    if rng.random() < 0.9:
        lines.append(f"Authorization: Bearer {token}".encode())
    lines += _framing(rng, body)
    for _ in range(rng.choice([0, 0, 1, 1, 2, 4])):
        # The last ones are no HTTP, or name the request's host and length a second time.
        name = rng.choice(HEADERS if rng.random() < 0.2 else HEADERS[:-4])
        lines.append(name.encode() + b": " + rng.choice(VALUES))
    if rng.random() < 0.01:
        lines += [b"X-%d: y" % n for n in range(3000)]
    if body[:1] == b"{" and rng.random() < 0.8:
        lines.append(b"Content-Type: application/json")
    request = b"\r\n".join(lines) + b"\r\n\r\n"
    if any(line.lower() == b"transfer-encoding: chunked" for line in lines):
        return request + _chunked(rng, body)
    return request + body


def _id(rng: random.Random, known: str) -> str:
    chance = rng.random()
    if chance < 0.55:
        return known
    if chance < 0.7:
        return known[:-1] + rng.choice("0123456789abcdefABCg")
    return _quoted(rng, rng.choice(TEXTS + NUMBERS))


def _value(rng: random.Random, ids: Mapping[str, str]) -> str:
    return rng.choice(
        [
            rng.choice(TEXTS),
            rng.choice(NUMBERS),
            rng.choice(CURSORS),
            *ids.values(),
            "cup",
            "7",
            "mm",
        ]
    )


def _quoted(rng: random.Random, text: str) -> str:
    """Escape as a client should; now and then only what would end the request line."""
    if rng.random() < 0.9:
        return quote(text.encode("utf-8", "surrogatepass"), safe="%")
    return text.replace(" ", "+").replace("\r", "").replace("\n", "")


def _body(rng: random.Random, ids: Mapping[str, str], npz: bytes) -> bytes:
    kind = rng.randrange(9)
    if kind == 0:
        return rng.randbytes(rng.choice([1, 10, 1000, 100_000]))
    if kind == 1:
        return npz[: rng.randrange(len(npz))]
    if kind == 2:
        damaged = bytearray(npz)
        for _ in range(rng.randrange(1, 20)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        return bytes(damaged)
    if kind == 3:
        return b"[" * 50_000
    if kind == 4:
        return b'{"ids": ' + b'{"a":' * 30_000
    if kind == 5:
        field = rng.choice([b"file", b"", b"x" * 5000, b'"', b"file\x00"])
        return (
            b'--x\r\nContent-Disposition: form-data; name="' + field + b'"; filename="../../x"\r\n'
            b"\r\n" + npz[:200] + rng.choice([b"\r\n--x--\r\n", b"\r\n--x", b"", b"--"])
        )
    if kind == 6:
        return npz
    names = ["ids", "modes", "model", "subject", "label", "topology", "reference", "", "__class__"]
    values: list[object] = [
        *(None, True, 0, -1, 1e308, 10**400, "", "\ud800", "é" * 1000, [], {}, [[]], "7"),
        *([ids["sequence_id"]], [ids["sequence_id"]] * 1500, ["0" * 64], {"a": {"b": []}}),
    ]
    made = {rng.choice(names): rng.choice(values) for _ in range(rng.choice([1, 2, 4]))}
    text = json.dumps(made).encode()
    return text.replace(b"1e+308", rng.choice([b"1e999", b"NaN", b"-Infinity", b"1e308"]))


def _framing(rng: random.Random, body: bytes) -> list[bytes]:
    if not body:
        return []
    chance = rng.random()
    if chance < 0.8:
        return [b"Content-Length: %d" % len(body)]
    if chance < 0.9:
        return [b"Transfer-Encoding: chunked"]
    if chance < 0.95:
        wrong = rng.choice([b"0", b"-5", b"abc", b"9" * 30, b"%d" % (len(body) + 50), b"1"])
        return [b"Content-Length: " + wrong]
    return [b"Content-Length: %d" % len(body), b"Transfer-Encoding: chunked"]


def _chunked(rng: random.Random, body: bytes) -> bytes:
    if rng.random() < 0.5:
        return b"%x\r\n" % len(body) + body + b"\r\n0\r\n\r\n"
    size = rng.choice([b"zz", b"-1", b"f" * 20, b"5;ext=" + b"a" * 9000, b"", b"1\r\n1\r\n1"])
    return size + b"\r\n" + body[:5000] + rng.choice([b"", b"\r\n", b"\r\n0\r\nX: y\r\n\r\n"])
