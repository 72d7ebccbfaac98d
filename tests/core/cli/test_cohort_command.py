"""Signatures of many recordings: each that of the library, none made twice, none lost."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from bent_surfaces import bent_beat
from click.testing import CliRunner

from modalmotion.cli import main
from modalmotion.formats import read_npz, write_npz
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import ResultStore, verify


def numbers(said: str) -> tuple[int, int, int]:
    """Signatures made, known before, and files that failed."""
    found = re.search(r"made +(\d+)\nknown +(\d+)\nfailures +(\d+)", said)
    assert found is not None, said
    made, known, failed = map(int, found.groups())
    return made, known, failed


def write_cohort(folder: Path, n: int, n_nodes: tuple[int, int] = (8, 8)) -> list[Path]:
    rng = np.random.default_rng(5)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"s{k:04}.npz" for k in range(n)]
    for path in paths:
        vertices = rng.normal(size=(4, n_nodes[0] * n_nodes[1], 3))
        np.savez(path, vertices=vertices, grid=n_nodes, topology="cup", unit="mm")
    return paths


def check_all(paths: list[Path], folder: Path, **asked: object) -> None:
    """Every signature is the one that the library gives, and the store is sound."""
    parameters = SignatureParameters(**asked)  # type: ignore[arg-type]
    with ResultStore(folder) as store:
        for path in paths:
            sequence = read_npz(path.read_bytes()).sequence
            kept = store.signature(sequence.id, parameters.key)
            assert np.array_equal(kept.amplitudes, modal_signature(sequence, parameters).amplitudes)
        assert len(store.all_signatures()) == len(paths)
    assert verify(folder).is_sound


def run(*words: object, code: int = 0) -> str:
    done = CliRunner().invoke(main, ["cohort", *map(str, words)])
    assert done.exit_code == code, done.output
    return done.output


@pytest.mark.parametrize("where", ["here", pytest.param("dask", marks=pytest.mark.thorough)])
def test_each_is_signed_once_and_failures_are_told(
    where: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    paths = write_cohort(tmp_path / "in", 5)
    (tmp_path / "in" / "bad.npz").write_text("bad")
    lines = [f"in/{path.name},P {n % 3},rest" for n, path in enumerate(paths)]
    manifest, out = tmp_path / "m.csv", tmp_path / "out"
    manifest.write_text("\n".join(["path,subject,label", *lines, "in/bad.npz,,", "in/no.npz,,"]))
    words: list[object] = [manifest, "-o", out, "--modes", 6, "--workers", 1]
    if where == "dask":
        words[-2:] = ["--scheduler", request.getfixturevalue("dask_cluster").address]
    said = run(*words, code=1)
    assert numbers(said) == (5, 0, 2)
    assert "bad.npz: Unrecognised file format (3 bytes)" in said
    check_all(paths, out, modes=6)
    with (out / "cohort.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [bool(row["error"]) for row in rows] == [False] * 5 + [True] * 2
    with ResultStore(out) as store:
        assert len(store.list_sequences(subject="P 1", label="rest").records) == 2
        assert not store.list_sequences().records[0].has_upload
    # Again: nothing is left but what failed, unless a file or what is stated of it has changed.
    assert numbers(run(*words, "--skip-unreadable"))[:2] == (0, 5)
    paths[0].write_bytes(paths[3].read_bytes())
    manifest.write_text(manifest.read_text().replace("P 1,rest", "P 1,stress"))
    assert numbers(run(*words, "--skip-unreadable"))[:2] == (1, 4)
    with ResultStore(out) as store:
        assert len(store.list_sequences(subject="P 1", label="stress").records) == 2
    # Other parameters are other signatures.
    words[words.index(6)] = 4
    assert numbers(run(*words, "--skip-unreadable"))[:2] == (5, 0)


def test_a_lost_signature_is_made_again(tmp_path: Path) -> None:
    paths = write_cohort(tmp_path / "in", 2)
    out = tmp_path / "out"
    run(tmp_path / "in", "-o", out, "--workers", 1, "--keep-vertices")
    next((out / "signatures").rglob("*.h5")).unlink()
    assert numbers(run(tmp_path / "in", "-o", out, "--workers", 1))[:2] == (1, 1)
    check_all(paths, out)
    with ResultStore(out) as store:
        for path in paths:
            sequence = read_npz(path.read_bytes()).sequence
            assert np.array_equal(store.sequence(sequence.id).vertices, sequence.vertices)


def test_rows_may_lie_elsewhere(tmp_path: Path) -> None:
    (path,) = write_cohort(tmp_path / "in", 1)
    manifest, out = tmp_path / "m.csv", tmp_path / "out"
    absent = f"file://{tmp_path}/absent.npz?secret=1"
    manifest.write_text(f"path\nfile://{path}\n{absent}\n")
    said = run(manifest, "-o", out, "--workers", 1, code=1)
    assert numbers(said)[0] == 1
    assert "it cannot be fetched: FileNotFoundError" in said
    check_all([path], out)


def test_a_table_that_names_nothing_is_refused(tmp_path: Path) -> None:
    for text, said in (("path\n", "names no recording"), ("picture\na.npz\n", "no column 'path'")):
        (tmp_path / "m.csv").write_text(text)
        assert said in run(tmp_path / "m.csv", "-o", tmp_path / "out", code=1)


@pytest.mark.parametrize("backwards", [False, True])
def test_closed_surfaces_of_one_mesh_have_one_kind_of_modes(
    tmp_path: Path, *, backwards: bool
) -> None:
    rng = np.random.default_rng(3)
    # By their shapes the first two are spheres, the last has the springs of its mesh.
    for number, angle in enumerate((0.3, 0.6, 3.4)):
        (tmp_path / f"{number}.npz").write_bytes(write_npz(bent_beat("strong", angle, rng)))
    names = sorted((f"{number}.npz" for number in range(3)), reverse=backwards)
    manifest, out = tmp_path / "m.csv", tmp_path / "out"

    def kinds(names: list[str]) -> list[str]:
        manifest.write_text("\n".join(["path", *names]))
        run(manifest, "-o", out, "--workers", 1)
        with (out / "cohort.csv").open(newline="") as table, ResultStore(out) as store:
            rows = csv.DictReader(table)
            return [store.signature(row["sequence_id"], row["key"]).surface for row in rows]

    straight = [name for name in names if name != "2.npz"]
    assert kinds(straight) == ["sphere"] * 2
    assert kinds(names) == ["mesh"] * 3
    # Nothing is made again, and what is stored decides nothing.
    assert kinds(names) == ["mesh"] * 3
    assert kinds(straight) == ["sphere"] * 2


def test_one_that_is_killed_goes_on(tmp_path: Path) -> None:
    paths = write_cohort(tmp_path / "in", 12, (32, 64))
    out = tmp_path / "out"
    words = ["cohort", str(tmp_path / "in"), "-o", str(out), "--workers", "2"]
    first = subprocess.Popen(
        [sys.executable, "-m", "modalmotion", *words],
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    end = time.monotonic() + 120
    while len(list((out / "signatures").rglob("*.h5"))) < 3:
        assert first.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < end
        time.sleep(0.005)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    said = run(*words[1:])
    made, known, _ = numbers(said)
    assert made + known == len(paths)
    assert made < len(paths)
    check_all(paths, out)
