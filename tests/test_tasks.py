"""Ten tasks, each in one line that tab completion finds, as the library's own help lists them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ellipsoid_images import labels

import modalmotion as mm
from modalmotion.arguments.checking import OF_ANSWERS
from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence

LINES = re.findall(r"^(\w+) +``(.+?)``", mm.__doc__ or "", flags=re.MULTILINE)
TASKS = ("read", "plot", "classify", "strain", "track", "encode", "decode", "train", "view")


@pytest.fixture(scope="module")
def beat() -> mm.MeshSequence:
    return mm.simulate_ventricle(
        grid=(12, 16), acquisition=mm.Acquisition(n_frames=12), rng=np.random.default_rng(1)
    )


def test_every_task_is_found_by_its_name() -> None:
    assert {*TASKS, "report", "save", "load", "modal_signature"} <= set(dir(mm))
    methods = {"signature", "plot", "classify", "strain", "encode", "view", "report", "save"}
    assert methods <= set(dir(mm.MeshSequence)) & set(dir(mm.Track))
    for kind in (mm.ModalSignature, mm.Model, mm.Classification):
        assert {"plot", "save"} <= set(dir(kind))
    # What users never need is below.
    assert not {"project_all", "superpose_all", "whole_count"} & set(dir(mm))


def test_a_figure_that_is_looked_for_on_a_recording_is_found(beat: mm.MeshSequence) -> None:
    for method, names in OF_ANSWERS.items():
        answer = getattr(beat, method)()
        for name in names:
            assert hasattr(answer, name)
            with pytest.raises(AttributeError, match=rf"Write \.{method}\(\)\.{name}"):
                getattr(beat, name)
    with pytest.raises(AttributeError, match=r"no attribute 'nothing'\.$"):
        beat.nothing  # type: ignore[attr-defined]  # noqa: B018
    model = mm.load_model()
    assert model.classify(beat).label == beat.classify(model).label


def test_the_lines_of_the_help_run(
    beat: mm.MeshSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert [task for task, _ in LINES] == [
        *("read", "signature", "plot", "classify", "strain", "track", "encode", "decode"),
        *("train", "view", "report", "save", "load"),
    ]
    monkeypatch.chdir(tmp_path)
    beat.save("beat.npz")
    Path("map.nii.gz").write_bytes(write_nifti(ImageSequence((labels(), labels(18.0)))))
    space: dict[str, Any] = {"mm": mm}
    for task, line in LINES:
        # Training has a test of its own below; the viewer of notebooks needs a notebook.
        if task not in ("train", "view"):
            exec(line, space)  # noqa: S102 (our own help)
    # A report of a label map has no word of the command line.
    of_labels = mm.report("map.nii.gz", "map.csv")  # type: ignore[arg-type]
    assert any("Label " in note for note in of_labels.caveats)
    assert not [note for note in of_labels.caveats if " --" in note]
    assert space["beat"].id == beat.id
    assert space["signature"].amplitudes.shape == (12, 7, 3)
    assert space["answer"].label in mm.load_model().classes
    assert space["strain"].end_systolic["GLS"].value < 0
    assert space["track"].ejection_fraction > 0
    assert np.abs(space["again"].vertices - beat.vertices).max() < 3
    assert {"beat.h5", "signature.png", "out"} <= {path.name for path in tmp_path.iterdir()}
    assert {path.suffix for path in Path("out").iterdir()} == {".pdf", ".json", ".csv", ".html"}


def test_a_table_of_files_is_trained_on(tmp_path: Path) -> None:
    rows = ["path,label,subject"]
    for seed, fraction in enumerate((0.2, 0.25, 0.6, 0.65)):
        name = f"{seed}.npz"
        parameters = mm.VentricleParameters(ejection_fraction=fraction)
        mm.simulate_ventricle(
            parameters, grid=(8, 12), acquisition=mm.Acquisition(n_frames=6)
        ).save(tmp_path / name)
        rows.append(f"{name},{'low' if fraction < 0.4 else 'high'},{seed}")
    (tmp_path / "cases.csv").write_text("\n".join(rows))
    cases = mm.read_cases(tmp_path / "cases.csv")
    assert [case.read().label for case in cases] == ["low", "low", "high", "high"]
    model = mm.train(tmp_path / "cases.csv", "mine")  # type: ignore[arg-type]
    assert model.classes == ("high", "low")
    assert model.save(tmp_path / "mine.h5").is_file()


@pytest.mark.filterwarnings("ignore:.*no unit of time")
@pytest.mark.parametrize("end", [".npz", ".h5", ".vtkhdf", ".glb", ".zip"])
def test_what_is_saved_is_loaded(beat: mm.MeshSequence, tmp_path: Path, end: str) -> None:
    again = mm.load(beat.save(tmp_path / f"beat{end}"))
    assert np.abs(again.vertices - beat.vertices).max() < 1e-4
    assert (again.faces == beat.faces).all()
    assert again.id == beat.id or end == ".glb"


def test_results_are_loaded_as_what_they_are(beat: mm.MeshSequence, tmp_path: Path) -> None:
    signature = beat.signature(modes=4)
    assert mm.load(signature.save(tmp_path / "s.h5")).parameters.key == signature.parameters.key
    answer = beat.classify()
    assert mm.load(answer.save(tmp_path / "a.h5")).label == answer.label
    model = mm.load_model()
    assert mm.load(model.save(tmp_path / "m.h5")).id == model.id
    template = mm.make_template(beat)
    assert mm.load(mm.save(template, tmp_path / "t.h5")).id == template.id
    stream = beat.encode(rms=0.5)
    assert mm.load(stream.save(tmp_path / "b.mms")).n_frames == beat.n_frames
    with pytest.raises(mm.ParameterError, match="has no format for a ModalSignature") as caught:
        signature.save(tmp_path / "s.npz")
    assert ".h5, .csv" in caught.value.remedy
    with pytest.raises(mm.NotFoundError):
        mm.load(tmp_path / "none.h5")


def test_pictures_of_every_kind(beat: mm.MeshSequence, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    signature = beat.signature(modes=4)
    model = mm.load_model()
    trade = mm.measure_tradeoff(beat)
    template = mm.make_template(beat)
    for value in (beat, signature, beat.readouts(), beat.strain(), model, model.card, trade):
        assert value.plot()._repr_png_().startswith(b"\x89PNG")
    for other in (beat.classify(), template):
        assert mm.plot(other, tmp_path / "one.pdf").axes
    assert (tmp_path / "one.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(mm.NotFoundError, match="no file 'beat'"):
        mm.plot("beat")
    with pytest.raises(mm.ParameterError, match="not have the suffix of a picture"):
        signature.plot("beat.jpg")


def test_values_show_themselves_in_the_unit_of_the_user(beat: mm.MeshSequence) -> None:
    signature = beat.signature()
    assert f"rms_error={signature.rms_error:.4g} mm" in repr(signature)
    readouts = beat.readouts()
    assert f"stroke_volume={readouts.stroke_volume:.4g} ml" in repr(readouts)
    assert 20 < readouts.stroke_volume < 200
    assert f"share={readouts.curve.share:.4g} %" in repr(readouts)
    assert repr(beat.strain()).startswith("Strain(GLS -")
    assert "unit" not in repr(mm.measure_tradeoff(beat))


def test_notes_of_a_file_are_warnings(beat: mm.MeshSequence, tmp_path: Path) -> None:
    path = beat.save(tmp_path / "beat.npz")
    with pytest.warns(UserWarning, match="cm") as caught:
        assert mm.read(path, unit="cm").unit == "cm"  # type: ignore[call-arg]
    assert [one.filename for one in caught] == [__file__]
