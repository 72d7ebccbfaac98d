"""Cohorts whose recordings lie elsewhere: in memory, behind a web server, on S3."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import import_module
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import fsspec
import numpy as np
import pytest
from click.testing import CliRunner
from fsspec.implementations.memory import MemoryFile, MemoryFileSystem

from modalmotion.errors import (
    LimitError,
    MalformedFileError,
    MissingExtraError,
    ParameterError,
    StoreError,
)
from modalmotion.exports.signature_pack import is_pack
from modalmotion.formats import write_npz
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.store import ResultStore, verify
from modalmotion_service.cohort import CohortJob, CohortReport, read_manifest, sign_cohort
from modalmotion_service.cohort.manifest import entries_by_name
from modalmotion_service.cohort.remote import RemoteFile, Source, source_of
from modalmotion_service.cohort.remote_systems import listed, stamps
from modalmotion_service.cohort.transfer import fetched, require_target, send
from modalmotion_service.commands.cohort import cohort
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.terms import Terms

P = ParamSpec("P")
T = TypeVar("T")

MOST = 1_000_000


class EngineHere(Engine):
    """Work is done at once, in this process: others do not see its memory."""

    n_workers = 1
    are_parsers_confined = False
    n_waiting: Mapping[str, int] = {}

    def require_ready(self) -> None:
        pass

    def submit_for(
        self, terms: Terms, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[T]:
        future: Future[T] = Future()
        future.set_result(fn(*args, **kwargs))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        pass


def beat(number: int) -> MeshSequence:
    vertices = np.random.default_rng([number, 3]).normal(size=(3, 36, 3))
    return mesh_sequence(vertices, grid=(6, 6), topology="cup", unit="mm")


@pytest.fixture
def bucket() -> Iterator[MemoryFileSystem]:
    system = fsspec.filesystem("memory")
    system.store.clear()
    system.pseudo_dirs[:] = [""]
    for number in range(3):
        system.pipe(f"/bucket/scans/{number}.npz", write_npz(beat(number)))
    yield system
    system.store.clear()


def run(source: Source, out: Path, **options: Any) -> CohortReport:
    job = CohortJob(read_manifest(source), out, max_file_bytes=MOST, **options)
    return sign_cohort(job, lambda _: EngineHere())


def reasons(report: CohortReport) -> dict[str, str]:
    return {path.name: reason for path, reason in report.failures}


def test_a_text_is_a_path_or_a_url() -> None:
    assert source_of("a/b.npz") == Path("a/b.npz")
    file = source_of("https://host/a/b.npz?X-Signature=secret")
    assert isinstance(file, RemoteFile)
    assert (file.name, file.shown) == ("b.npz", "https://host/a/b.npz")
    assert not file.is_pattern
    assert str(RemoteFile("s3://b/a.csv").beside("x.npz")) == "s3://b/x.npz"
    assert RemoteFile("s3://b/*.npz").is_pattern


@pytest.mark.parametrize(
    "text",
    ["s3://me:secret@host/a", "zip://a.npz::s3://b/a.zip", "file:///etc/passwd", "s3://b/\0"],
)
def test_a_url_that_cannot_be_used_is_refused_and_not_repeated(text: str) -> None:
    with pytest.raises(ParameterError) as caught:
        source_of(text)
    assert "secret" not in str(caught.value)


def test_a_folder_elsewhere_becomes_a_folder_of_signatures(
    bucket: MemoryFileSystem, tmp_path: Path
) -> None:
    bucket.pipe("/bucket/scans/notes.txt", b"no sequence")
    source, out = RemoteFile("memory://bucket/scans"), tmp_path / "out"
    report = run(source, out)
    assert (report.n_made, report.failures) == (3, ())
    # Known by size and time, and done again where those are others.
    assert (run(source, out).n_known, run(source, out).n_made) == (3, 0)
    bucket.pipe("/bucket/scans/1.npz", write_npz(beat(7)))
    report = run(source, out)
    assert (report.n_made, report.n_known) == (1, 2)
    rows = list(csv.DictReader((out / "cohort.csv").read_text().splitlines()))
    assert [row["path"] for row in rows] == [f"memory:///bucket/scans/{n}.npz" for n in range(3)]
    assert [row["sequence_id"] for row in rows] == [beat(n).id for n in (0, 7, 2)]
    assert verify(out).is_sound
    assert list((out / "spool").iterdir()) == []


def test_manifests_name_files_elsewhere_from_their_own_folder(
    bucket: MemoryFileSystem, tmp_path: Path
) -> None:
    text = "path,subject\n0.npz,P 0\nmemory://bucket/scans/1.npz,P 1\n"
    bucket.pipe("/bucket/scans/m.csv", text.encode())
    report = run(RemoteFile("memory://bucket/scans/m.csv"), tmp_path / "out")
    assert (report.n_made, report.failures) == (2, ())
    (tmp_path / "2.npz").write_bytes(write_npz(beat(2)))
    (tmp_path / "m.csv").write_text(f"path,subject\n2.npz,P 2\n{text.splitlines()[2]}\n")
    assert run(tmp_path / "m.csv", tmp_path / "other").n_made == 2
    with ResultStore(tmp_path / "other") as store:
        assert {r.subject for r in store.list_sequences().records} == {"P 1", "P 2"}
    bucket.pipe("/bucket/scans/m.csv", b"path\ns3://me:word@host/a.npz\n")
    with pytest.raises(MalformedFileError, match=r"Line 2 of 'm.csv'.*a name or a password"):
        read_manifest(RemoteFile("memory://bucket/scans/m.csv"))
    # Of files that were sent to a service a table names nothing elsewhere.
    (entry,) = entries_by_name("path\nmemory://bucket/scans/1.npz\n", "t.csv").values()
    assert isinstance(entry.path, Path)


def test_folders_of_frames_and_patterns_elsewhere_are_sequences(
    bucket: MemoryFileSystem, tmp_path: Path
) -> None:
    off = "OFF\n4 4 0\n{0} 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
    for number in range(3):
        bucket.pipe(f"/bucket/frames/f{number}.off", off.format(0.1 * number).encode())
    names = ["frames", "frames/f*.off"]
    for name in names:
        with fetched(RemoteFile(f"memory://bucket/{name}"), tmp_path, MOST) as path:
            shown = path.parent if "*" in path.name else path
            assert sorted(p.name for p in shown.iterdir()) == ["f0.off", "f1.off", "f2.off"]
    assert list(tmp_path.iterdir()) == []
    before = stamps([RemoteFile("memory://bucket/frames")])
    bucket.pipe("/bucket/frames/f3.off", b"")
    assert before != stamps([RemoteFile("memory://bucket/frames")])


def test_what_is_not_there_is_named_and_the_others_are_done(
    bucket: MemoryFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MalformedFileError, match="'memory://nowhere/scans' is not there"):
        read_manifest(RemoteFile("memory://nowhere/scans"))
    with pytest.raises(MalformedFileError, match="is not there"):
        read_manifest(RemoteFile("memory://nowhere/m.csv"))
    entries = read_manifest(RemoteFile("memory://bucket/scans"))
    bucket.rm("/bucket/scans/1.npz")
    job = CohortJob(entries, tmp_path / "out")
    report = sign_cohort(job, lambda _: EngineHere())
    assert report.n_made == 2
    assert "1.npz' is not there" in reasons(report)["1.npz"]
    assert verify(tmp_path / "out").is_sound


def test_sizes_are_looked_at_before_and_while_a_file_is_read(
    bucket: MemoryFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = RemoteFile("memory://bucket/big.npz")
    bucket.pipe("/bucket/big.npz", b"x" * (MOST + 1))
    opened: list[str] = []
    monkeypatch.setattr(MemoryFileSystem, "_open", lambda self, path, **_: opened.append(path))
    with pytest.raises(LimitError, match=r"'memory://bucket/big\.npz' has 1000001"):
        fetched(file, tmp_path, MOST).__enter__()
    assert opened == []
    monkeypatch.undo()
    # A server that does not say how much it has.
    info = MemoryFileSystem.info
    monkeypatch.setattr(
        MemoryFileSystem, "info", lambda self, path, **_: {**info(self, path), "size": None}
    )
    with pytest.raises(LimitError):
        fetched(file, tmp_path, MOST).__enter__()
    assert list(tmp_path.iterdir()) == []


class Breaking:
    """Connections that break after some bytes, a few times."""

    def __init__(self, n: int) -> None:
        self.n = n

    def __get__(self, system: MemoryFileSystem, _: type) -> Callable[..., Any]:
        return lambda path, *_, **__: self.open(system, path)

    def open(self, system: MemoryFileSystem, path: str) -> Any:
        whole = system.store[path].getvalue()
        self.n -= 1
        return io.BytesIO(whole if self.n < 0 else whole[: len(whole) // 2])


@pytest.mark.parametrize(("n", "is_read"), [(2, True), (3, False)])
def test_a_connection_that_breaks_is_tried_again_and_leaves_nothing(
    n: int,
    is_read: bool,
    bucket: MemoryFileSystem,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("modalmotion_service.cohort.transfer.time.sleep", lambda _: None)
    monkeypatch.setattr(MemoryFileSystem, "_open", Breaking(n))
    report = run(RemoteFile("memory://bucket/scans/0*"), tmp_path / "out")
    assert (report.n_made == 1) == is_read
    if not is_read:
        (reason,) = reasons(report).values()
        assert reason.startswith("The connection to 'memory:///bucket/scans/0.npz' failed or broke")
        assert "only unfinished files are processed" in reason
    assert verify(tmp_path / "out").is_sound
    assert list((tmp_path / "out" / "spool").iterdir()) == []


@pytest.mark.parametrize(
    "error", [PermissionError("no"), type("NoCredentialsError", (OSError,), {})]
)
def test_missing_credentials_are_named_with_where_they_are_looked_for(
    error: Any, bucket: MemoryFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise error

    monkeypatch.setattr(MemoryFileSystem, "_open", refuse)
    with pytest.raises(MalformedFileError, match="credentials") as caught:
        fetched(RemoteFile("memory://bucket/scans/0.npz"), tmp_path, MOST).__enter__()
    assert "AWS_ACCESS_KEY_ID" in caught.value.remedy


def test_what_no_package_reaches_names_the_command(tmp_path: Path, monkeypatch: Any) -> None:
    for package in ("s3fs", "aiohttp", "gcsfs"):
        monkeypatch.setitem(sys.modules, package, None)
    # What was imported before, with the package.
    monkeypatch.delitem(sys.modules, "fsspec.implementations.http", raising=False)
    for scheme in ("s3", "http", "https", "gs"):
        monkeypatch.delitem(import_module("fsspec.registry")._registry, scheme, raising=False)
    for url, package in (
        ("s3://bucket/scans", "s3fs"),
        ("https://host/a.npz?X-Signature=word", "aiohttp"),
        ("http://host/a.npz", "aiohttp"),
    ):
        with pytest.raises(MissingExtraError, match=f"{package}, the package for") as caught:
            listed(RemoteFile(url))
        assert f"pip install {package};" in caught.value.remedy
        assert "pip install fsspec aiohttp s3fs" in caught.value.remedy
        assert "word" not in f"{caught.value.message}{caught.value.remedy}"
    with pytest.raises(MissingExtraError, match="a package for gs is not") as caught:
        listed(RemoteFile("gs://bucket/scans"))
    assert "what fsspec needs for gs" in caught.value.remedy
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingExtraError, match="package fsspec"):
        listed(RemoteFile("s3://bucket/scans"))


def test_a_scheme_that_nobody_knows_is_refused() -> None:
    with pytest.raises(ParameterError, match="nothing here knows nonsense"):
        listed(RemoteFile("nonsense://bucket/scans"))


def test_a_pack_is_sent_whole_or_not_at_all(
    bucket: MemoryFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.npz").write_bytes(write_npz(beat(1)))
    target = RemoteFile("memory://bucket/packs/all.h5")
    words = [str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--workers", "1", "--modes", "6"]
    done = CliRunner().invoke(cohort, [*words, "--pack", target.url])
    assert done.exit_code == 0, done.output
    assert f"1 signatures packed: {target.url}" in done.output
    with bucket.open("/bucket/packs/all.h5") as file:
        assert is_pack(file)
    whole = bucket.cat("/bucket/packs/all.h5")
    # Made anew over one of an earlier run, and over nothing else.
    require_target(target)
    bucket.pipe("/bucket/other.h5", b"something else")
    with pytest.raises(ParameterError, match="is not a pack"):
        require_target(RemoteFile("memory://bucket/other.h5"))
    refused = CliRunner().invoke(cohort, [*words, "--pack", "memory://bucket/other.h5"])
    assert "is not a pack" in str(refused.exception or refused.output)
    with pytest.raises(ParameterError, match="a web server only gives"):
        require_target(RemoteFile("https://host/all.h5"))

    class Broken(MemoryFile):  # type: ignore[misc]
        def write(self, data: Any) -> int:
            raise ConnectionResetError(104, "Connection reset by peer")

    monkeypatch.setattr("fsspec.implementations.memory.MemoryFile", Broken)
    (tmp_path / "pack").write_bytes(b"new")
    with pytest.raises(StoreError, match=r"could not be written: .*Connection reset"):
        send(tmp_path / "pack", target)
    monkeypatch.undo()
    assert bucket.cat("/bucket/packs/all.h5") == whole
    assert list((tmp_path / "out" / "spool").iterdir()) == []


def test_results_are_kept_on_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    refused = CliRunner().invoke(cohort, ["m.csv", "-o", "s3://bucket/out"])
    assert refused.exit_code == 2
    assert "is no folder of this machine" in refused.output
    assert list(tmp_path.iterdir()) == []


class Web(BaseHTTPRequestHandler):
    """A server of a few files, some of which break."""

    files: Mapping[str, bytes] = {}

    def do_HEAD(self) -> None:
        self.answer(is_head=True)

    def do_GET(self) -> None:
        self.answer(is_head=False)

    def answer(self, *, is_head: bool) -> None:
        path = self.path.partition("?")[0]
        if path == "/secret.npz":
            self.send_error(403)
            return
        content = self.files.get(path)
        if content is None:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("ETag", f'"{len(content)}"')
        self.end_headers()
        if not is_head:
            n = len(content) // 2 if path == "/broken.npz" else len(content)
            self.wfile.write(content[:n])
            self.close_connection = True

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        pass


@contextmanager
def served(files: Mapping[str, bytes]) -> Iterator[str]:
    handler = type("Files", (Web,), {"files": files})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_recordings_behind_a_web_server_are_read_by_workers(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp", reason="http:// needs aiohttp, of the extra remote")
    good = write_npz(beat(1))
    files = {f"/{name}.npz": good for name in ("good", "secret", "broken")}
    files["/m.csv"] = b"path\ngood.npz?sig=word\nbroken.npz\nsecret.npz\ngone.npz\n"
    with served(files) as address:
        words = [f"{address}/m.csv", "-o", str(tmp_path / "out"), "--workers", "1", "--modes", "6"]
        done = CliRunner().invoke(cohort, words)
        assert done.exit_code == 1, done.output
        assert "1 signatures made" in done.output
        assert "3 files failed" in done.output
        assert f"The connection to '{address}/broken.npz' failed or broke" in done.stderr
        assert f"'{address}/secret.npz' may not be used with the credentials" in done.stderr
        assert f"'{address}/gone.npz' is not there" in done.stderr
        assert "1 known" in CliRunner().invoke(cohort, words).output
    assert verify(tmp_path / "out").is_sound


@contextmanager
def s3_server(folder: Path) -> Iterator[str]:
    """Run a server of S3's protocol, from the package moto."""
    with (folder / "s3.log").open("wb") as log:
        command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", "0"]
        server = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        for _ in range(300):
            said = (folder / "s3.log").read_text()
            if "Running on" in said:
                yield said.partition("Running on ")[2].split()[0]
                return
            assert server.poll() is None, said
            threading.Event().wait(0.1)
        raise AssertionError(said)
    finally:
        server.terminate()
        server.wait()


def commanded(words: list[str]) -> subprocess.CompletedProcess[str]:
    """Run the command as a program, whose workers have the environment of now."""
    command = [sys.executable, "-m", "modalmotion", "cohort", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.soak
@pytest.mark.filterwarnings("default")
def test_a_cohort_from_s3_to_s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("s3fs", "moto", "flask"):
        pytest.importorskip(
            package,
            reason="s3:// needs s3fs, and its server moto: both are at "
            "odds with pinned packages, so they are in an environment of their own",
        )
    with s3_server(tmp_path) as address:
        for name, value in (
            ("AWS_ACCESS_KEY_ID", "key"),
            ("AWS_SECRET_ACCESS_KEY", "word"),
            ("AWS_ENDPOINT_URL", address),
            ("AWS_DEFAULT_REGION", "us-east-1"),
        ):
            monkeypatch.setenv(name, value)
        system = fsspec.filesystem("s3")
        system.mkdir("scans")
        for number in range(20):
            system.pipe(f"scans/day/{number:02d}.npz", write_npz(beat(number)))
        system.pipe("scans/day/bad.npz", b"bad")
        words = ["s3://scans/day", "-o", str(tmp_path / "out"), "--workers", "2", "--modes", "6"]
        words += ["--pack", "s3://scans/all.h5"]
        done = commanded(words)
        assert done.returncode == 1, done.stderr
        assert "20 signatures made" in done.stdout
        assert "s3://scans/day/bad.npz: These 3 bytes are of no format" in done.stderr
        assert "20 signatures packed: s3://scans/all.h5" in done.stdout
        with fetched(RemoteFile("s3://scans/all.h5"), tmp_path, 1 << 30) as pack:
            assert is_pack(pack)
        system.pipe("scans/day/00.npz", write_npz(beat(99)))
        system.rm("scans/day/bad.npz")
        again = commanded(words)
        assert "1 signatures made" in again.stdout
        assert "19 known before" in again.stdout
        with pytest.raises(MalformedFileError, match="'s3://no-such-bucket/x' is not there"):
            listed(RemoteFile("s3://no-such-bucket/x"))
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            monkeypatch.delenv(name)
        monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
        monkeypatch.setenv("HOME", str(tmp_path))
        type(system).clear_instance_cache()
        with pytest.raises(MalformedFileError, match="credentials"):
            listed(RemoteFile("s3://scans/day"))
        type(system).clear_instance_cache()
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "word")
    with pytest.raises(MalformedFileError, match="The connection to 's3://scans/day'"):
        listed(RemoteFile("s3://scans/day"))
    assert verify(tmp_path / "out").is_sound
    assert list((tmp_path / "out" / "spool").iterdir()) == []
