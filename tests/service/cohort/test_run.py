"""A folder of files becomes a folder of signatures, whatever is killed meanwhile."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bent_surfaces import bent_beat
from click.testing import CliRunner
from clouds import small_recording
from dask_cluster import DaskCluster
from warm_start import WarmProcess, start_warm

from modalmotion import Acquisition, simulate_ventricle
from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.formats import read_npz, write_npz
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import ResultStore, signature_from_hdf5, verify
from modalmotion_service.cohort import CohortJob, read_manifest, sign_cohort
from modalmotion_service.cohort.ledger import Done, Ledger
from modalmotion_service.cohort.manifest import Entry
from modalmotion_service.cohort.run import MOST_IN_BATCH, batch_size
from modalmotion_service.commands.cohort import cohort
from modalmotion_service.work.pool import WorkerPool


def write_cohort(folder: Path, n: int, n_nodes: tuple[int, int] = (8, 8)) -> list[Path]:
    folder.mkdir()
    paths = [folder / f"s{number:04d}.npz" for number in range(n)]
    for number, path in enumerate(paths):
        rng = np.random.default_rng(number)
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
    report = verify(folder)
    assert report.is_sound
    assert not report.orphans
    assert list((folder / "spool").iterdir()) == []


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "modalmotion", "cohort", *map(str, arguments)]


def n_kept(folder: Path) -> int:
    return len(list((folder / "signatures").rglob("*.h5")))


def started(arguments: list[str], said: Path) -> WarmProcess:
    with said.open("wb") as sink:
        return start_warm(
            "cluster",
            *arguments[2:],
            environment=os.environ,
            folder=Path.cwd(),
            sink=sink,
            is_session=True,
        )


def wait_for_some(process: subprocess.Popen[bytes] | WarmProcess, folder: Path, n: int) -> None:
    end = time.monotonic() + 120
    while n_kept(folder) < n:
        assert process.poll() is None, "it ended before it could be disturbed"
        assert time.monotonic() < end
        time.sleep(0.01)


def test_tables_and_pictures_in_a_folder_are_no_sequences(tmp_path: Path) -> None:
    (path,) = write_cohort(tmp_path / "files", 1)
    for name in ("cases.csv", "cases.jsonl", "notes.txt", "beat.png"):
        (path.parent / name).write_text("path,label\n")
    assert [entry.path for entry in read_manifest(path.parent)] == [path.absolute()]


def test_a_manifest_names_files_from_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("\ufefflabel, path,age\nrest,a.npz,3\n,b/c.npz,4\n")
    (tmp_path / "m.jsonl").write_text('{"path": "a.npz", "label": "rest"}\n\n{"path": "b/c.npz"}\n')
    for name in ("m.csv", "m.jsonl"):
        first, second = read_manifest(tmp_path / name)
        assert (first.path, first.label, first.subject) == (tmp_path / "a.npz", "rest", None)
        assert (second.path, second.label) == (tmp_path / "b" / "c.npz", None)


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("m.csv", "file\na.npz\n", 1),
        ("m.csv", "path,label\na.npz,x\n\n ,y\n", 4),
        ("m.csv", "path\na.npz\na.npz\n", 3),
        ("m.csv", "path\na.npz,b\n", 2),
        ("m.csv", "path,label\na.npz," + "x" * 300 + "\n", 2),
        ("m.jsonl", '{"path": "a"}\nnonsense\n', 2),
        ("m.jsonl", "[1]\n", 1),
        ("m.jsonl", '{"path": 3}\n', 1),
    ],
)
def test_a_wrong_manifest_names_its_line(tmp_path: Path, name: str, text: str, line: int) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(MalformedFileError, match=f"Line {line} of '{name}'") as caught:
        read_manifest(tmp_path / name)
    assert caught.value.details["line"] == line


@pytest.mark.parametrize("name", ["m.csv", "m.txt", "folder", "*.npz"])
def test_a_manifest_that_names_nothing_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "m.csv").write_text("path\n")
    with pytest.raises(MalformedFileError):
        read_manifest(tmp_path / name)


def test_batches_get_smaller_towards_the_end_and_are_never_empty() -> None:
    sizes: list[int] = []
    while sum(sizes) < 500:
        sizes.append(batch_size(500 - sum(sizes), 2))
    assert sum(sizes) == 500
    assert sizes == sorted(sizes, reverse=True)
    assert (sizes[0], sizes[-1]) == (MOST_IN_BATCH, 1)
    # Whatever is left is never one worker's alone.
    assert all(batch_size(n, 2) <= max(1, n // 2) for n in range(1, 1000))


@pytest.mark.every(2)
@pytest.mark.parametrize("engine", ["processes", "dask"])
def test_a_cohort_is_signed_and_failures_are_told(
    engine: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    paths = write_cohort(tmp_path / "in", 12)
    (tmp_path / "in" / "bad.npz").write_text("bad")
    lines = [f"in/{path.name},P {n % 3},rest" for n, path in enumerate(paths)]
    manifest, out = tmp_path / "m.csv", tmp_path / "out"
    manifest.write_text("\n".join(["path,subject,label", *lines, "in/bad.npz,,", "in/no.npz,,"]))
    where = ["--workers", "2"]
    if engine == "dask":
        where = ["--scheduler", request.getfixturevalue("dask_cluster").address]
    arguments = [str(manifest), "-o", str(out), "--modes", "6", *where]
    run = CliRunner().invoke(cohort, [*arguments, "--pack", str(tmp_path / "pack.h5")])
    assert run.exit_code == 1, run.output
    assert "12 signatures made" in run.output
    assert "bad.npz: These 3 bytes are of no format" in run.stderr
    assert "no.npz: 'no.npz' cannot be read" in run.stderr
    assert (tmp_path / "pack.h5").stat().st_size > 0
    check_all(paths, out, modes=6)
    with (out / "cohort.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [bool(row["error"]) for row in rows] == [False] * 12 + [True] * 2
    assert all((out / row["signature"]).is_file() for row in rows[:12])
    with ResultStore(out) as store:
        assert len(store.list_sequences(subject="P 1", label="rest").records) == 4
    # Again: nothing is left but what failed, unless a file or the settings have changed.
    skipped = CliRunner().invoke(cohort, [*arguments, "--skip-unreadable"])
    assert (skipped.exit_code, "files failed" in skipped.output) == (0, True)
    again = CliRunner().invoke(cohort, [*arguments, "--pack", str(tmp_path / "pack.h5")])
    assert "0 signatures made" in again.output
    assert "12 signatures packed" in again.output
    refused = CliRunner().invoke(cohort, [*arguments, "--pack", str(manifest)])
    assert (refused.exit_code, "is not a pack" in refused.output) == (2, True)
    assert "12 known" in again.output
    paths[0].write_bytes(paths[3].read_bytes())
    manifest.write_text(manifest.read_text().replace("P 1,rest", "P 1,stress"))
    again = CliRunner().invoke(cohort, arguments)
    assert "1 signatures made" in again.output
    with ResultStore(out) as store:
        assert len(store.list_sequences(subject="P 1", label="stress").records) == 4


def test_a_services_folder_is_not_a_cohorts(tmp_path: Path) -> None:
    (source,) = write_cohort(tmp_path / "in", 1)
    waiting = tmp_path / "data" / "spool" / "upload-of-a-job"
    waiting.parent.mkdir(parents=True)
    (tmp_path / "data" / "access").mkdir()
    waiting.touch()
    job = CohortJob(read_manifest(source.parent), tmp_path / "data")
    with pytest.raises(ParameterError, match="data folder of a service"):
        sign_cohort(job, lambda folder: WorkerPool(1, 60, 1 << 30))
    assert waiting.exists()


def test_rows_of_clouds_are_tracked_first_and_again_where_their_landmarks_change(
    tmp_path: Path,
) -> None:
    write_cohort(tmp_path / "in", 1)
    (tmp_path / "in" / "clouds.npz").write_bytes(small_recording(2))
    out = tmp_path / "out"

    def run(apex: str) -> tuple[str, str, str]:
        rows = ("path;landmark:apex;landmark:base", "s0000.npz;;", f"clouds.npz;{apex};0,0,40")
        (tmp_path / "in" / "m.csv").write_text("\n".join(rows))
        words = [str(tmp_path / "in" / "m.csv"), "-o", str(out), "--workers", "1"]
        found = CliRunner().invoke(cohort, [*words, "--kind", "offset"])
        assert found.exit_code == 0, found.output
        sequence, cloud = csv.DictReader((out / "cohort.csv").read_text().splitlines())
        return sequence["sequence_id"], cloud["sequence_id"], found.output

    first = run("0,0,-40")
    with ResultStore(out) as store:
        assert store.sequence_record(first[0]).facts.tracking == "unknown"
        record = store.sequence_record(first[1])
        assert (record.facts.tracking, record.topology) == ("offset", "cup")
    again = run("0,0,-40")
    assert again[:2] == first[:2]
    assert "2 known" in again[2]
    assert run("0,0,-38")[1] != first[1]


def test_one_template_serves_a_cohort(tmp_path: Path) -> None:
    paths = write_cohort(tmp_path / "in", 3)
    out = tmp_path / "out"
    arguments = [str(tmp_path / "in"), "-o", str(out), "--workers", "1", "--keep-vertices"]
    run = CliRunner().invoke(cohort, [*arguments, "--template-from", str(paths[0])])
    assert run.exit_code == 0, run.output
    (template,) = (out / "templates").rglob("*.h5")
    with ResultStore(out) as store:
        for path in paths:
            sequence = read_npz(path.read_bytes()).sequence
            parameters = SignatureParameters(template=template.stem)
            assert store.signature(sequence.id, parameters.key).template_id == template.stem
            assert store.sequence(sequence.id).id == sequence.id


def test_a_ledger_gives_places_and_keeps_no_lines(tmp_path: Path) -> None:
    several = [Done(f"Zoë {n}.npz", "stamp", "set", f"{n}" * 64, n, n, "mm", "k") for n in range(3)]
    ledger = Ledger(tmp_path)
    places = ledger.add(several[0]) + ledger.add(*several[1:])
    assert [ledger.at(place) for place in places] == several
    with (tmp_path / "cohort.jsonl").open("a") as file:
        # Of an older version, which had no key; and cut short.
        file.write('{"path": "old", "stamp": "s", "settings": "set", "sequence_id": "i", ')
        file.write('"rms_error": 1, "weighted_rms_error": 1, "unit": null}\n{"path": "cut sho')
    again = Ledger(tmp_path)
    assert again.find("cut sho", "s", "set") is None
    assert again.find("Zoë 1.npz", "other", "set") is None
    for one in several:
        place = again.find(one.path, "stamp", "set")
        assert place is not None
        assert again.at(place) == one
    old = again.find("old", "s", "set")
    assert old is not None
    assert again.at(old).key == ""
    again.forget_earlier()
    assert again.find("old", "s", "set") is None
    assert again.at(again.add(several[0])[0]) == several[0]


def kill_and_go_on(tmp_path: Path, n: int) -> None:
    paths = write_cohort(tmp_path / "in", n, (32, 64))
    out = tmp_path / "out"
    arguments = command(tmp_path / "in", "-o", out, "--workers", 2, "--batch", 2)
    first = started(arguments, tmp_path / "said")
    wait_for_some(first, out, 4)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    with (out / "cohort.jsonl").open("a") as file:
        file.write('{"path": "cut sho')
    again = CliRunner().invoke(cohort, arguments[4:])
    assert again.exit_code == 0, again.output
    made, known = (int(again.stdout.split(before)[0].split()[-1]) for before in (" sign", " known"))
    assert made + known == n
    assert 0 < made < n
    check_all(paths, out)


def test_a_cohort_that_is_killed_goes_on(tmp_path: Path) -> None:
    kill_and_go_on(tmp_path, 24)


@pytest.fixture
def own_cluster(tmp_path: Path, warm_bridges: None) -> Iterator[DaskCluster]:
    cluster = DaskCluster(tmp_path / "dask")
    yield cluster
    cluster.stop()


def disturb(own_cluster: DaskCluster, tmp_path: Path, n: int) -> None:
    """A worker is killed, then the scheduler: all come out right, in one go."""
    paths = write_cohort(tmp_path / "in", n, (32, 64))
    out = tmp_path / "out"
    own_cluster.start(2)
    arguments = command(tmp_path / "in", "-o", out, "--scheduler", own_cluster.address)
    run = started([*arguments, "--batch", "2"], tmp_path / "said")
    wait_for_some(run, out, n // 10)
    own_cluster.workers[0].kill()
    wait_for_some(run, out, n // 3)
    own_cluster.kill_scheduler()
    time.sleep(0.5)
    kept = n_kept(out)
    assert kept < n
    own_cluster.start_scheduler()
    assert run.wait(300) == 0, (tmp_path / "said").read_text()
    check_all(paths, out)


@pytest.mark.thorough
def test_a_cohort_survives_a_lost_worker_and_scheduler(
    own_cluster: DaskCluster, tmp_path: Path
) -> None:
    disturb(own_cluster, tmp_path, 24)


@pytest.mark.soak
def test_500_sequences_survive_a_lost_worker_and_scheduler(
    own_cluster: DaskCluster, tmp_path: Path
) -> None:
    disturb(own_cluster, tmp_path, 500)


@pytest.mark.soak
def test_500_sequences_survive_the_end_of_the_command(tmp_path: Path) -> None:
    kill_and_go_on(tmp_path, 500)


@pytest.mark.soak
def test_a_scheduler_that_stays_away_ends_the_cohort_and_it_resumes(
    own_cluster: DaskCluster, tmp_path: Path
) -> None:
    paths = write_cohort(tmp_path / "in", 40, (32, 64))
    out = tmp_path / "out"
    own_cluster.start(1)
    arguments = command(tmp_path / "in", "-o", out, "--scheduler", own_cluster.address)
    run = subprocess.Popen([*arguments, "--batch", "1", "--patience", "1"], stderr=subprocess.PIPE)
    wait_for_some(run, out, 3)
    own_cluster.kill_scheduler()
    _, said = run.communicate(timeout=120)
    assert run.returncode == 1
    assert b"files are done and kept. When there is a scheduler" in said
    again = CliRunner().invoke(cohort, [str(tmp_path / "in"), "-o", str(out), "--workers", "2"])
    assert again.exit_code == 0, again.output
    assert " 0 files failed" in again.stdout
    assert " 0 known before" not in again.stdout
    check_all(paths, out)


def test_facts_of_a_manifest_are_kept_and_read_and_known_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    mesh = simulate_ventricle(n_vertices=120, acquisition=Acquisition(n_frames=3), rng=rng)
    (tmp_path / "a.npz").write_bytes(write_npz(mesh))
    manifest, out = tmp_path / "m.csv", tmp_path / "out"
    manifest.write_text('path,tracking,landmark:theta_zero\na.npz,offset,"30,0,0"\n')
    arguments = [str(manifest), "-o", str(out), "--workers", "1"]
    first = CliRunner().invoke(cohort, arguments)
    assert first.exit_code == 0, first.output
    with ResultStore(out) as store:
        facts = store.sequence_record(mesh.id).facts
        assert (facts.tracking, facts.modality) == ("offset", "simulated")
        (key,) = store.signatures(mesh.id)
        assert store.signature(mesh.id, key).landmarks.given == ("theta_zero",)  # type: ignore[union-attr]
    assert "1 known" in CliRunner().invoke(cohort, arguments).output
    # Another landmark is another signature; another tracking is not.
    manifest.write_text('path,tracking,landmark:theta_zero\na.npz,material,"0,30,0"\n')
    assert "1 signatures made" in CliRunner().invoke(cohort, arguments).output
    with ResultStore(out) as store:
        assert len(store.signatures(mesh.id)) == 2
        assert store.sequence_record(mesh.id).facts.tracking == "material"
    manifest.write_text('path,tracking,landmark:theta_zero\na.npz,offset,"0,30,0"\n')
    assert "1 known" in CliRunner().invoke(cohort, arguments).output


@pytest.mark.parametrize("backwards", [False, True])
def test_closed_surfaces_of_one_mesh_have_one_kind_of_modes(
    tmp_path: Path, *, backwards: bool
) -> None:
    rng = np.random.default_rng(3)
    files = tmp_path / "files"
    files.mkdir()
    # By their shapes the first two are spheres, the last has the springs of its mesh.
    for number, angle in enumerate((0.3, 0.6, 3.4)):
        (files / f"{number}.npz").write_bytes(write_npz(bent_beat("strong", angle, rng)))
    paths = sorted(files.glob("*.npz"), reverse=backwards)
    straight = [one for one in paths if one.stem != "2"]
    folder = tmp_path / "cohort"

    def kinds(paths: list[Path]) -> list[str]:
        job = CohortJob(tuple(Entry(path) for path in paths), folder)
        report = sign_cohort(job, lambda _: WorkerPool(1, 60, 1 << 30))
        assert (report.n_made + report.n_known, report.failures) == (len(paths), ())
        with (folder / "cohort.csv").open(newline="") as table:
            rows = list(csv.DictReader(table))
        return [signature_from_hdf5(folder / row["signature"]).surface for row in rows]

    assert kinds(straight) == ["sphere"] * 2
    assert kinds(paths) == ["mesh"] * 3
    # Nothing is made again, and what is stored decides nothing.
    assert kinds(paths) == ["mesh"] * 3
    assert kinds(straight) == ["sphere"] * 2
