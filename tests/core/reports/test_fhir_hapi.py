"""Reports that HAPI FHIR's validator reads: it finds nothing, but what was spoilt on purpose."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clouds import breathing_spheroid, sampled
from fhir_validator import complaints, with_hapi
from norm_controls import beat

import modalmotion as mm
from modalmotion.classification import classify
from modalmotion.mesh import facts_from_texts
from modalmotion.norm import train_norm
from modalmotion.reports import fhir_bundle, report_of
from modalmotion.simulate import MotionClass
from modalmotion.tracking import track

ISSUED = datetime(2026, 1, 31, 12, tzinfo=UTC)
Change = Callable[[mm.MeshSequence, np.random.Generator], mm.MeshSequence]


def unchanged(sequence: mm.MeshSequence, _: np.random.Generator) -> mm.MeshSequence:
    return sequence


def unitless(sequence: mm.MeshSequence, _: np.random.Generator) -> mm.MeshSequence:
    return replace(sequence, unit=None)


def untimed(sequence: mm.MeshSequence, _: np.random.Generator) -> mm.MeshSequence:
    return replace(sequence, times=None, facts=replace(sequence.facts, period=None))


def uneven(sequence: mm.MeshSequence, rng: np.random.Generator) -> mm.MeshSequence:
    steps = rng.uniform(0.01, 0.09, sequence.n_frames)
    return replace(sequence, times=np.cumsum(steps), facts=replace(sequence.facts, period=None))


def of_a_scan(sequence: mm.MeshSequence, rng: np.random.Generator) -> mm.MeshSequence:
    stated = {
        "cavity": str(rng.choice(["lv", "rv", "la", "unknown"])),
        "modality": str(rng.choice(["MR", "CT", "US"])),
    }
    return replace(sequence, facts=facts_from_texts(stated).over(sequence.facts))


def large(sequence: mm.MeshSequence, _: np.random.Generator) -> mm.MeshSequence:
    """So large that no class is left."""
    return replace(sequence, vertices=sequence.vertices * 4.0)


def flat(_: mm.MeshSequence, rng: np.random.Generator) -> mm.MeshSequence:
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0), indexing="ij")
    z = rng.normal(size=8)[:, None, None] * np.cos(x)
    frames = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1)
    return mm.mesh_sequence(frames.reshape(8, 30, 3), grid=(6, 5), topology="plane")


def tracked(_: mm.MeshSequence, rng: np.random.Generator) -> mm.MeshSequence:
    moving = breathing_spheroid(4)
    return track(
        [sampled(x, moving.faces, 150, rng, 0.3) for x in moving.vertices],
        modes=7,
        unit="mm",
        times=np.arange(4) * 0.2,
    ).sequence


CHANGES: tuple[Change, ...] = (
    *(unchanged, unitless, untimed, uneven, of_a_scan, large, flat, tracked),
)


def drawn(n: int) -> Iterator[dict[str, Any]]:
    """Bundles of results of every kind, with and without class and deviation."""
    norm = train_norm([beat(seed) for seed in range(19)], "volunteers")
    kinds = list(MotionClass)
    for seed in range(n):
        rng = np.random.default_rng(seed)
        change = CHANGES[seed % len(CHANGES)]
        # None of the controls.
        sequence = change(beat(100 + seed, kinds[seed % len(kinds)]), rng)
        is_whole = change in (unchanged, untimed, uneven, of_a_scan, large)
        parts: dict[str, Any] = {}
        if is_whole and rng.random() < 0.7:
            parts["classification"] = classify(sequence)
        if change in (unchanged, of_a_scan) and rng.random() < 0.5:
            parts["deviation"] = norm.deviation(sequence)
        signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
        yield fhir_bundle(report_of(signature, sequence, issued=ISSUED, **parts))


@with_hapi
@pytest.mark.soak
@pytest.mark.timeout(900)
def test_of_two_hundred_drawn_results_hapi_finds_nothing(tmp_path: Path) -> None:
    bundles = {f"{k:03}": bundle for k, bundle in enumerate(drawn(200))}
    assert complaints(bundles, tmp_path) == []


@with_hapi
@pytest.mark.soak
@pytest.mark.timeout(900)
def test_hapi_finds_what_was_spoilt(tmp_path: Path) -> None:
    (bundle,) = drawn(1)
    resources = [entry["resource"] for entry in bundle["entry"]]
    n = next(k for k, one in enumerate(resources) if one["resourceType"] == "Observation")

    def spoilt(**fields: Any) -> dict[str, Any]:
        wrong = copy.deepcopy(bundle)
        wrong["entry"][n]["resource"].update(fields)
        return wrong

    wrong = {
        "status": spoilt(status="perhaps"),
        "issued": spoilt(issued="yesterday"),
        "unknown": spoilt(colour="red"),
        "code": spoilt(code={"coding": [{"system": "urn:modalmotion:codes", "code": "none"}]}),
        "nothing": spoilt(code=None),
        "sound": bundle,
    }
    said = complaints(wrong, tmp_path)
    assert {line.partition(".")[0] for line in said} == set(wrong) - {"sound"}
