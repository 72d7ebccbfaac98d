"""What a page is sent: enough to show what the library reconstructs, and small."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from viewed_surfaces import VIEWED, viewed

from modalmotion.classification import classify
from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.strain import strain
from modalmotion.clinical.ventricle import sensitivities
from modalmotion.errors import LimitError, ParameterError
from modalmotion.mesh import Facts, lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.topologies import CUP, Topology
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template.body_frame import from_local
from modalmotion.viewer import payload
from modalmotion.viewer.container import read_container
from modalmotion.viewer.payload import frames_payload, view_payload


def positions(data: bytes) -> NDArray[np.float64]:
    """Surfaces that a payload stands for, by the formula in its text, from the centroid."""
    header, a = read_container(data)
    if header["ends"] is None:
        shapes = a["shapes"].astype(float).T
    else:
        topology = Topology.parse(header["surface"])
        modes = ModeSet(
            topology,
            np.array(header["wavenumbers"]),
            np.array(header["sines"], dtype=bool),
        )
        shapes = modes.shapes_at(a["coordinates"].astype(float))
    u = np.einsum("vm,fmd->fvd", shapes, a["amplitudes"].astype(float))
    if "directions" in a:
        u = from_local(u, a["directions"].astype(float))
    d = a["translations"].astype(float)[:, None]
    R = Rotation.from_quat(a["quaternions"]).as_matrix()
    y = a["rest"] + u - (d if header["holds_drift"] else 0.0)
    x: NDArray[np.float64] = y @ R.transpose(0, 2, 1) + d
    return x


@pytest.mark.parametrize("name", VIEWED)
def test_a_payload_stands_for_what_the_library_reconstructs(name: str) -> None:
    sequence, signature = viewed(name)
    shown = positions(view_payload(signature, sequence))
    true = reconstruct(signature, sequence)
    # The page's origin is a centroid, which it need not know.
    shown += (true[0] - shown[0]).mean(axis=0)
    extent = np.ptp(true[0], axis=0).max()
    assert np.abs(shown - true).max() <= 1e-4 * extent


def test_a_vertex_in_no_triangle_moves_as_the_nearest_one() -> None:
    sequence, _ = viewed("cup")
    vertices = np.asarray(sequence.vertices)
    loose = vertices[:, 40:41] + np.array([0.4, 0.1, 0.2])
    faces = lattice_faces(CUP, (9, 12))
    joined = mesh_sequence(np.concatenate([vertices, loose], axis=1), faces, topology="cup")
    signature = modal_signature(joined)
    true = reconstruct(signature, joined)
    shown = positions(view_payload(signature, joined))
    shown += (true[0] - shown[0]).mean(axis=0)
    assert np.abs(shown - true).max() <= 1e-4 * np.ptp(true[0], axis=0).max()


def test_frames_as_sent_are_right_to_a_65536th_of_their_box() -> None:
    sequence, signature = viewed("cup")
    header, arrays = read_container(view_payload(signature, sequence))
    del header
    for first, stop in ((0, 5), (3, 4)):
        piece, frames = read_container(frames_payload(sequence, signature, first, stop))
        assert piece["first"] == first
        assert frames["frames"].shape == (stop - first, sequence.n_vertices, 3)
        x = np.array(piece["low"]) + frames["frames"] * np.array(piece["step"])
        own = sequence.vertices[first:stop] - sequence.vertices[0].mean(axis=0)
        shift = (own - x).mean(axis=(0, 1))
        assert np.abs(own - x - shift).max() <= 0.51 * max(piece["step"])
    assert "rest" in arrays


def test_the_first_payload_of_a_real_ventricle_is_light(
    real_sequence: Callable[[str], MeshSequence],
) -> None:
    sequence = real_sequence("heart/lv_endocardium")
    for modes, most in ((7, 65_000), (54, 80_000)):
        signature = modal_signature(sequence, SignatureParameters(modes=modes))
        assert len(view_payload(signature, sequence)) <= most


def test_the_header_speaks_plain_words() -> None:
    beat = simulate_ventricle()
    signature = modal_signature(beat)
    header, arrays = read_container(
        view_payload(signature, beat, classification=classify(beat), title="a beat")
    )
    assert header["title"] == "a beat"
    assert header["cycle"] == "closes"
    assert header["waves"][2]["modes"] == [2, 3]
    assert header["waves"][2]["label"] == "(0, 1)"
    assert header["waves"][2]["name"] == "radial contraction"
    assert header["volume"]["share"]["name"] == "ejection fraction"
    assert header["volume"]["share"]["low"] <= header["volume"]["share"]["value"]
    assert header["segments"]["names"] == ["basal", "mid", "apical", "apex"]
    assert "anterior" in header["segments"]["reason"]
    assert [one["name"] for one in header["volume"]["figures"]] == ["EDV", "ESV", "SV"]
    assert [one["name"] for one in header["strain"]["figures"]] == ["GLS", "GCS", "GAS", "SDI"]
    for one in (*header["volume"]["figures"], *header["strain"]["figures"]):
        assert one["definition"]
        assert one["low"] <= one["value"] <= one["high"]
    assert arrays["strain"].shape == (beat.n_frames, 3)
    gls = strain(beat)
    figure = header["strain"]["figures"][0]
    assert arrays["strain"][gls.end_systole, 0] == pytest.approx(figure["value"], abs=1e-5)
    assert figure["peak"]["value"] == pytest.approx(gls.curves[:, 0].min())
    assert beat.times is not None
    start, peak = beat.times[gls.end_diastole], beat.times[gls.curves[:, 0].argmin()]
    assert figure["time_to_peak"] == pytest.approx(peak - start)
    inward, longitudinal = header["segments"]["quantities"][:2]
    assert (inward["name"], len(inward["values"])) == ("Inward motion", 4)
    assert longitudinal["values"] == pytest.approx(gls.by_segment[gls.end_systole, :, 0], abs=0.01)
    assert header["classification"]["explanation"][0]["modes"]
    assert "medical device" in header["intended_use"]


def test_each_mode_has_its_largest_effect_on_each_read_out() -> None:
    beat = simulate_ventricle(grid=(12, 24), acquisition=Acquisition(n_frames=12))
    signature = modal_signature(beat)
    answer = classify(beat)
    header, _ = read_container(view_payload(signature, beat, classification=answer))
    per_mode = sensitivities(signature, beat, clinical_readouts(signature, beat))
    effects = header["effects"]
    assert effects["step"] == "1 mm"
    assert not any(effects["waves"][0][0])  # a translation changes nothing
    assert effects["names"] == ["EDV", "ESV", "ejection fraction", "GLS", "GCS", "GAS", "SDI"]
    assert effects["units"] == list(per_mode.units)
    gls = effects["names"].index("GLS")
    values, ways = effects["waves"][1]
    assert effects["directions"][ways[gls]] == "z, cosine"
    assert values[gls] == pytest.approx(per_mode.values[gls, 1, 2], rel=0.01)
    assert header["waves"][2]["modes"] == [2, 3]
    values, ways = effects["waves"][2]
    assert abs(values[gls]) == pytest.approx(np.abs(per_mode.values[gls, 2:4]).max(), rel=0.01)
    assert len(effects["waves"]) == len(header["waves"])
    first = header["classification"]["explanation"][0]
    assert (first["per_unit"], first["unit"]) == (answer.explanation[0].per_unit, "mm")


def test_refused_read_outs_and_unknown_units_are_words() -> None:
    sequence, signature = viewed("plane")
    header, arrays = read_container(view_payload(replace(signature, unit=None), sequence))
    assert "plane" in header["volume"]["refused"]
    # Programs go by the code, in whichever words it is.
    assert header["volume"]["codes"] == ["unsupported_topology"]
    assert "volumes" not in arrays
    assert header["unit"] == "length units"
    assert header["effects"] is None
    assert header["classification"] is None


@pytest.mark.parametrize(
    ("period", "cycle"), [(1.0, "closes"), (0.85, "repeats"), (None, "closes")]
)
def test_a_stated_period_says_how_a_cycle_closes(period: float | None, cycle: str) -> None:
    sequence, signature = viewed("cup")
    stated = replace(signature, facts=Facts(period=period))
    assert read_container(view_payload(stated, sequence))[0]["cycle"] == cycle


def test_a_movement_that_does_not_come_back_is_no_cycle() -> None:
    vertices = viewed("cup")[0].vertices[:3]
    moved = vertices[0] + np.array([0.0, 1.0, 2.0, 3.0])[:, None, None] * (
        vertices[2] - vertices[0]
    )
    sequence = mesh_sequence(moved, grid=(9, 12), topology="cup")
    header, _ = read_container(view_payload(modal_signature(sequence), sequence))
    assert header["cycle"] == "open"


@pytest.mark.parametrize("size", [1e-200, 1e-12, 1e12, 1e150])
def test_extreme_lengths_are_sent_in_another_unit(size: float) -> None:
    sequence, _ = viewed("cup")
    vertices = np.asarray(sequence.vertices) - sequence.vertices[0].mean(axis=0)
    extreme = mesh_sequence(size * vertices, grid=(9, 12), topology="cup")
    data = view_payload(modal_signature(extreme), extreme)
    header, arrays = read_container(data)
    assert 0.1 < np.abs(arrays["rest"]).max() < 10.0
    assert header["unit"].endswith("length units")
    assert header["unit"] != "length units"
    assert np.isfinite(positions(data)).all()
    json.dumps(header, allow_nan=False)


def test_too_many_shapes_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence, signature = viewed("mesh")
    monkeypatch.setattr(payload, "MOST_SHAPES", 100)
    with pytest.raises(LimitError, match="fewer modes") as caught:
        view_payload(signature, sequence)
    assert caught.value.limit == "view_shapes"


def test_another_sequence_is_refused() -> None:
    _, signature = viewed("cup")
    with pytest.raises(ParameterError):
        view_payload(signature, viewed("plane")[0])
