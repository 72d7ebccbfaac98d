"""Training, testing and asking a model on the command line."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from bent_surfaces import bent_cohort
from click.testing import CliRunner, Result
from clouds import small_recording

from modalmotion import Facts
from modalmotion.classification import classify
from modalmotion.cli import main
from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle
from modalmotion.store import model_from_hdf5, track_from_hdf5

N_PER_CLASS = 6
# Where it does not matter how scores come about, and where they are read.
QUICK = ("--repetitions", "1", "--kind", "material")
FULL = ("--repetitions", "2", "--kind", "material")
CLASSES = (MotionClass.NORMAL, MotionClass.HYPOKINESIA)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def succeed(*arguments: object) -> Result:
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labelled ventricles in folders named by class, a manifest of them, and a model."""
    folder = tmp_path_factory.mktemp("cases")
    rng = np.random.default_rng(1)
    rows = []
    for number in range(N_PER_CLASS + 2):
        for label in CLASSES:
            sequence = simulate_ventricle(
                draw_parameters(label, rng),
                grid=(6, 12),
                acquisition=Acquisition(n_frames=10, noise=0.3),
                rng=rng,
            )
            path = folder / label / f"{number}.npz"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(write_npz(sequence))
            rows.append([f"{label}/{number}.npz", str(label), f"{label} {number}"])
    split = 2 * N_PER_CLASS
    for name, some in (("train", rows[:split]), ("test", rows[split:])):
        with (folder / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows([["path", "label", "subject"], *some])
    succeed("train", folder / "train.csv", "--name", "wall", "-o", folder / "wall.h5", *QUICK)
    return folder


def test_training_writes_a_model_and_says_how_it_does(folder: Path, tmp_path: Path) -> None:
    out, plot = tmp_path / "m.h5", tmp_path / "m.png"
    asked = ("train", folder / "train.csv", "--name", "wall")
    cases = tmp_path / "cases.csv"
    result = succeed(*asked, *FULL, "-o", out, "--plot", plot, "--cases", cases)
    for words in (
        *("true class", "Class sets", "calibration", "subjects", "repetitions"),
        *("AUC", "Log loss", "Brier", "sensitivity", "specificity"),
    ):
        assert words in result.output
    with cases.open() as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == 2 * 2 * N_PER_CLASS
    assert {Path(row["case"]).parent.name for row in rows} == set(map(str, CLASSES))
    assert all(row["subject"].startswith(row["class"]) for row in rows)
    assert plot.read_bytes().startswith(b"\x89PNG")
    # The same cases give the same model, to the last bit of every answer.
    again, other, wall = tmp_path / "m.h5", tmp_path / "other.h5", folder / "wall.h5"
    succeed(*asked, *QUICK, "-o", again)
    assert model_from_hdf5(again).id == model_from_hdf5(wall).id
    succeed(*asked, *QUICK, "-o", other, "--modes", 7)
    assert model_from_hdf5(other).id != model_from_hdf5(wall).id


def test_files_are_labelled_by_the_folders_they_lie_in(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.h5"
    files = sorted(folder.glob("*/*.npz"))
    succeed("train", *files, "--name", "by-folder", "-o", out, *QUICK)
    model = model_from_hdf5(out)
    assert model.classes == tuple(sorted(map(str, CLASSES)))
    assert sum(model.card.n_cases.values()) == len(files)


def test_a_model_is_tested_on_other_cases(folder: Path, tmp_path: Path) -> None:
    plot = tmp_path / "test.png"
    model, manifest = folder / "wall.h5", folder / "test.csv"
    cases = tmp_path / "cases.csv"
    result = succeed(
        *("evaluate", model, manifest, "--coverage", 0.8, "--plot", plot, "--cases", cases)
    )
    with cases.open() as table:
        listed = list(csv.DictReader(table))
    with manifest.open() as table:
        assert [row["subject"] for row in listed] == [
            row["subject"] for row in csv.DictReader(table)
        ]
    n_empty = sum(not row["class_set"] for row in listed)
    said = " ".join(result.output.split())
    for words in ("cases 4 ", "accuracy interval", "true class", "coverage 0.800"):
        assert words in said
    assert f" empty sets {n_empty} " in said
    assert plot.read_bytes().startswith(b"\x89PNG")
    answer = json.loads(succeed("evaluate", model, manifest, "--json").stdout)
    assert answer["n_cases"] == 4
    assert answer["n_empty_sets"] == sum(not case["class_set"] for case in answer["cases"])
    assert answer["model_id"] == model_from_hdf5(model).id
    with (folder / "test.csv").open() as file:
        rows = list(csv.DictReader(file))
    right = 0
    for row in rows:
        path = folder / row["path"]
        said = json.loads(succeed("classify", path, "--model", model, "--json").stdout)
        right += said["label"] == row["label"]
    assert answer["accuracy"] == right / len(rows)


def test_classify_says_what_the_library_says(folder: Path, tmp_path: Path) -> None:
    path, plot = folder / "normal" / "0.npz", tmp_path / "answer.png"
    model = model_from_hdf5(folder / "wall.h5")
    sequence = read_npz(path.read_bytes()).sequence
    own = classify(modal_signature(sequence, model.signature_parameters), model, 0.8)
    asked = ("classify", path, "--model", folder / "wall.h5", "--coverage", 0.8)
    answer = json.loads(succeed(*asked, "--json").stdout)
    assert list(answer["probabilities"].values()) == own.probabilities.tolist()
    assert (answer["label"], answer["class_set"]) == (own.label, list(own.class_set))
    assert answer["sequence_id"] == sequence.id
    text = succeed(*asked, "--plot", plot).output
    assert "cannot be excluded at 80 %" in text
    assert all(label in text for label in model.classes)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_a_simulated_cohort_is_a_manifest_and_its_files(tmp_path: Path) -> None:
    first, second, other = (tmp_path / name for name in "abc")
    for folder, seed in ((first, 3), (second, 3), (other, 4)):
        succeed("simulate-cohort", "-o", folder, "--per-class", 1, "--seed", seed)
    files = {path.name: path.read_bytes() for path in first.iterdir()}
    assert files == {path.name: path.read_bytes() for path in second.iterdir()}
    assert set(files) != {path.name for path in other.iterdir()}
    with (first / "cases.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert {row["label"] for row in rows} == set(map(str, MotionClass))
    assert len({row["subject"] for row in rows}) == len(rows) == len(files) - 1


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_manifests_of_any_spreadsheet_are_read(
    folder: Path, tmp_path: Path, delimiter: str
) -> None:
    from modalmotion.classification.manifest import LabelledSequence, read_manifest

    wanted = read_manifest(folder / "train.csv")
    manifest = folder / f"other-{ord(delimiter)}.csv"
    lines = [["Subject", "PATH", "Label", "Age"]]
    age = "61.5" if delimiter == "," else "61,5"
    lines += [[row.subject or "", f"{row.label}/{row.path.name}", row.label, age] for row in wanted]
    text = "\r\n".join(delimiter.join(line) for line in lines)
    manifest.write_bytes(b"\xef\xbb\xbf" + text.encode())
    facts = Facts(covariates={"age": 61.5})
    assert read_manifest(manifest) == [replace(row, facts=facts) for row in wanted]
    case = LabelledSequence(read_manifest(manifest)[0], {}).read()
    assert case.covariates == {"age": 61.5}


def with_manifest(folder: Path, name: str, *lines: str) -> Path:
    path = folder / name
    path.write_text("\n".join(lines))
    return path


def test_mistakes_are_told_in_one_line_and_name_what_is_wrong(folder: Path, tmp_path: Path) -> None:
    good = [f"normal/{n}.npz,normal" for n in range(3)]
    good += [f"{CLASSES[1]}/{n}.npz,{CLASSES[1]}" for n in range(3)]
    head = "path,label"
    flat = mesh_sequence(np.zeros((3, 4, 3)), grid=(2, 2), topology="cup", unit="mm")
    (folder / "flat.npz").write_bytes(write_npz(flat))
    (folder / "text.npz").write_bytes(b"no archive")
    out = tmp_path / "m.h5"
    numbers = count()

    def train(*lines: str, name: str = "wall") -> tuple[object, ...]:
        manifest = with_manifest(folder, f"bad-{next(numbers)}.csv", *lines)
        return ("train", manifest, "--name", name, "-o", out)

    model, test = folder / "wall.h5", folder / "test.csv"
    broken = tmp_path / "broken.h5"
    broken.write_bytes(model.read_bytes()[:-1])
    strange = with_manifest(folder, "strange.csv", head, "normal/0.npz,strange")
    latin, wide, bare = (tmp_path / f"{name}.csv" for name in ("latin", "wide", "bare"))
    latin.write_text("path,label\na.npz,schw\u00e4che\n", "latin-1")
    wide.write_text("path,label\na.npz,weak\n", "utf-16")
    bare.write_text("path,label\na.npz,weak\n", "utf-16-le")
    mistakes: list[tuple[tuple[object, ...], list[str]]] = [
        (train("picture,class", *good), ["no column 'path'"]),
        (train(), ["no column 'path'"]),
        (train(head, *good, "normal/9.npz,normal"), ["Line 8", "normal/9.npz"]),
        (train(head, *good, "normal/4.npz,"), ["Line 8", "no label"]),
        (train(head, *good, ",normal"), ["Line 8", "no path"]),
        (train(head, *good, good[0]), ["0.npz", "2 times"]),
        (train(head, *good[:3]), ["two classes"]),
        (train(head, *good, "text.npz,normal"), ["text.npz"]),
        (train(head, *good, "flat.npz,normal"), ["flat.npz"]),
        (train(head, *good, name="No Name"), ["No Name", "lower-case"]),
        ((*train(head, *good), "--modes", 0), ["modes"]),
        ((*train(head, *good), "--timing", "oracle"), ["oracle"]),
        (("train", folder / "none.npz", "--name", "w", "-o", out), ["none.npz"]),
        (("train", folder / "none.csv", "--name", "w", "-o", out), ["none.csv"]),
        (("evaluate", model, strange), ["normal/0.npz has the class 'strange'"]),
        (("train", latin, "--name", "w", "-o", out), ["as UTF-8", "(Excel: CSV UTF-8)"]),
        (("train", wide, "--name", "w", "-o", out), ["as UTF-8", "(Excel: CSV UTF-8)"]),
        (("train", bare, "--name", "w", "-o", out), ["no column 'path'", "(Excel: CSV UTF-8)"]),
        (("evaluate", "nobody", test), ["nobody"]),
        (("evaluate", broken, test), ["broken.h5"]),
        (("classify", folder / "normal/0.npz", "--model", folder / "test.csv"), ["test.csv"]),
        (("classify", folder / "normal/0.npz", "--coverage", 1), ["coverage"]),
    ]
    for arguments, words in mistakes:
        result = run(*arguments)
        assert result.exit_code != 0, arguments
        assert result.exception is None or isinstance(result.exception, SystemExit), arguments
        for word in words:
            assert word in result.output, (arguments, result.output)
        assert "Traceback" not in result.output
        assert not out.exists()


def test_files_that_do_not_fit_are_left_out_on_request_and_named(
    folder: Path, tmp_path: Path
) -> None:
    rows = (folder / "train.csv").read_text().splitlines()
    (folder / "broken.npz").write_bytes(b"no archive")
    rows[1:1] = ["broken.npz,normal,X", "missing.npz,normal,Y"]
    manifest = with_manifest(folder, "faulty.csv", *rows)
    out = tmp_path / "m.h5"
    asked = ("train", manifest, "--name", "wall", "-o", out, *QUICK)
    refused = run(*asked)
    assert refused.exit_code == 1
    assert "--skip-unreadable" in refused.output
    said = succeed(*asked, "--skip-unreadable").output
    assert "Cases left out: 2." in said
    for name in ("broken.npz", "missing.npz"):
        assert f"{folder / name}: " in said
    assert model_from_hdf5(out).id == model_from_hdf5(folder / "wall.h5").id
    # A test goes on in the same way.
    tested = ("evaluate", out, manifest)
    assert run(*tested).exit_code == 1
    said = succeed(*tested, "--skip-unreadable").output
    assert f"cases                      {2 * N_PER_CLASS}\n" in said
    assert "Cases left out: 2." in said
    answer = json.loads(succeed(*tested, "--skip-unreadable", "--json").stdout)
    assert answer["n_cases"] == 2 * N_PER_CLASS


def test_a_column_of_the_manifest_is_groups(folder: Path, tmp_path: Path) -> None:
    rows = (folder / "train.csv").read_text().splitlines()
    rows = [f"{rows[0]},Site", *(f"{row},{k // 2 % 3}" for k, row in enumerate(rows[1:]))]
    manifest = with_manifest(folder, "sites.csv", *rows)
    asked = ("train", manifest, "--name", "wall", "-o", tmp_path / "m.h5", *QUICK)
    assert succeed(*asked, "--groups", "site").output
    refused = run(*asked, "--groups", "scanner")
    assert refused.exit_code == 1
    assert "site" in refused.output


def test_tracks_stand_in_tables_as_their_sequences(tmp_path: Path) -> None:
    rows = []
    for k in range(4):
        (tmp_path / f"{k}.npz").write_bytes(small_recording(2, seed=k))
        name = f"{k}.h5"
        succeed("track", tmp_path / f"{k}.npz", "-o", tmp_path / name, "--modes", 4)
        rows.append(f"{name},{'ab'[k % 2]},s{k}")
    manifest = with_manifest(tmp_path, "cases.csv", "path,label,subject", *rows)
    model, out = tmp_path / "tracks.h5", tmp_path / "features.csv"
    options = ("--modes", 4, "--repetitions", 1)
    said = succeed("train", manifest, "--name", "tracks", "-o", model, *options, "--folds", 2)
    assert "Has seen: 4 recordings of 4 subjects: 2 a, 2 b" in said.output
    succeed("features", manifest, "-o", out, "--modes", 4)
    with out.open() as file:
        found = [line["sequence_id"] for line in csv.DictReader(file)]
    assert found == [track_from_hdf5(tmp_path / f"{k}.h5").sequence.id for k in range(4)]
    assert succeed("classify", tmp_path / "0.h5", "--model", model).output


def test_the_features_of_a_cohort_are_a_table(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "features.csv"
    head, *rows = (folder / "train.csv").read_text().splitlines()
    aged = [f"{row},{50 + k}" for k, row in enumerate(rows)]
    manifest = with_manifest(folder, "aged.csv", f"{head},Age", *aged)
    said = succeed("features", manifest, "-o", out, "--covariate", "age").output
    with out.open() as file:
        table = list(csv.DictReader(file))
    assert [line["case"] for line in table] == [str(folder / row.split(",")[0]) for row in rows]
    assert [line["label"] for line in table] == [row.split(",")[1] for row in rows]
    assert [float(line["covariate age"]) for line in table] == [50 + k for k in range(len(rows))]
    told = f"cases {len(rows)} features {len(table[0]) - 4} reads parts about the axis"
    assert told in " ".join(said.split())
    # Labels are not needed, and what does not fit is named.
    bare = with_manifest(folder, "bare.csv", "path", *(row.split(",")[0] for row in rows), "no.npz")
    refused = run("features", bare, "-o", tmp_path / "b.csv")
    assert (refused.exit_code, (tmp_path / "b.csv").exists()) == (1, False)
    assert "no.npz" in refused.output
    said = succeed("features", bare, "-o", tmp_path / "b.csv", "--skip-unreadable").output
    assert "Cases left out: 1." in said
    with (tmp_path / "b.csv").open() as file:
        plain = list(csv.DictReader(file))
    assert [line["label"] for line in plain] == [""] * len(rows)
    assert all(
        line[name] == plain[k][name]
        for k, line in enumerate(table)
        for name in plain[0]
        if name not in ("label", "subject")
    )
    assert "weight" in run("features", manifest, "-o", out, "--covariate", "weight").output


@pytest.mark.thorough
def test_a_cohort_of_bent_surfaces_needs_no_option_and_its_model_none_again(
    tmp_path: Path,
) -> None:
    """Alone, half of them are spheres and half of them have no straight axis."""
    for name, n_per_class, seed in (("train", 4, 1), ("test", 3, 2)):
        rows = []
        for number, (sequence, label) in enumerate(bent_cohort(n_per_class, seed)):
            path = tmp_path / f"{name}-{number}.npz"
            path.write_bytes(write_npz(sequence))
            rows.append([path.name, label, f"{seed} {number}"])
        with (tmp_path / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows([["path", "label", "subject"], *rows])
    out = tmp_path / "bent.h5"
    for topology, surface in (((), "mesh"), (("--topology", "sphere"), "sphere")):
        said = succeed(
            "train", tmp_path / "train.csv", "--name", "bent", "-o", out, *topology, *QUICK
        )
        assert ("its spring modes" in said.output) == (not topology)
        assert model_from_hdf5(out).readable.topology == surface
        result = json.loads(succeed("evaluate", out, tmp_path / "test.csv", "--json").stdout)
        assert result["abstained"] <= 0.25
        assert result["accuracy"] >= 0.6
    for number in range(2):
        answer = succeed("classify", tmp_path / f"test-{number}.npz", "--model", out).output
        assert "topology" not in answer
    # The printed word is accepted where a topology is asked for; this model reads spheres.
    asked = ("classify", tmp_path / "test-0.npz", "--model", out, "--topology", "mesh")
    assert "this one's is mesh" in succeed(*asked).output
    refused = run("train", tmp_path / "train.csv", "--name", "bent", "-o", out, "--topology", "cup")
    assert refused.exit_code == 1
    assert "train-0.npz: A cup was stated" in refused.output
