"""One interval for each number: no output states less than the track does."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.strain import strain
from modalmotion.clinical.ventricle import ventricle_readouts
from modalmotion.exports.tables import Recording, cohort_table, frame_table
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.notes import Note
from modalmotion.reports import fhir_json, report_of
from modalmotion.reports.content import quantities_of
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.vibration_modes import surface_modes
from modalmotion.viewer.container import read_container
from modalmotion.viewer.page import View

ISSUED = datetime(2026, 1, 31, 12, tzinfo=UTC)
BEAT = simulate_ventricle(
    grid=(12, 24), acquisition=Acquisition(n_frames=6), rng=np.random.default_rng(1)
)
SHAPES = surface_modes(make_template(BEAT), 7).shapes
SIGNATURE = modal_signature(BEAT, SignatureParameters(modes=7))
NOTE = "In 1 frames points lie at less than 80% of the surface."


def tracked(seed: int) -> MeshSequence:
    """A sequence with errors as tracks state them, drawn anew."""
    rng = np.random.default_rng([38, seed])
    n, m = BEAT.n_frames, 3 * SHAPES.shape[1]
    factors = 10.0 ** rng.uniform(-1.5, 0.5) * rng.normal(size=(n, m, m)) / np.sqrt(m)
    covariances = factors @ factors.transpose(0, 2, 1)
    volumes = 10.0 ** rng.uniform(2.0, 4.0) * rng.uniform(0.5, 1.5, n)
    known = Uncertainty(
        source=str(rng.choice(["points", "images"])),
        shapes=SHAPES,
        across=covariances,
        along=covariances,
        rest=np.full(n, 0.2),
        alike=np.full(BEAT.n_vertices, BEAT.n_vertices / 60.0),
        volumes=volumes,
        papillary_volume=float(rng.choice([0.0, 4000.0])),
        notes=(Note("told", NOTE),),
    )
    return replace(BEAT, uncertainty=known)


@pytest.mark.parametrize(
    "seeds", [range(30), pytest.param(range(30, 500), marks=pytest.mark.thorough)]
)
def test_no_output_states_less_than_the_track_does(seeds: range) -> None:
    for seed in seeds:
        sequence = tracked(seed)
        readouts = clinical_readouts(SIGNATURE, sequence)
        known = sequence.uncertainty
        assert known is not None
        assert known.volumes is not None
        v, sd = readouts.mesh_curve.volumes, known.volumes
        ed, es = int(v.argmax()), int(v.argmin())
        width = 100.0 * 4.0 * np.hypot(sd[es], v[es] / v[ed] * sd[ed]) / v[ed]
        for curve in (readouts.curve, readouts.mesh_curve):
            low, high = curve.share_range or (0.0, 0.0)
            assert high - low > 0.99 * width or low == 0.0 or high == 100.0
            low, high = curve.end_diastolic_range
            assert high - low > 3.99 * sd.min()
        assert NOTE in map(str, readouts.notes)
        assert known.source in readouts.notes[-2]
        if seed % 25 == 0:
            check_outputs(sequence, width)


def check_outputs(sequence: MeshSequence, width: float) -> None:
    """Every form of the numbers has the interval, the notes and the origin."""
    fitted = modal_signature(sequence, SignatureParameters(modes=7))
    report = report_of(fitted, sequence, issued=ISSUED)
    stated = {one.name: one for one in quantities_of(report)}
    ef = stated["ejection_fraction"]
    assert ef.high - ef.low > 0.99 * width or ef.low == 0.0 or ef.high == 100.0
    assert NOTE in report.caveats
    text = fhir_json(report).decode()
    assert NOTE in text
    found = re.search(r"Ejection fraction [\d.]+ % \(([\d.]+) to ([\d.]+)\)", text)
    assert found is not None
    assert float(found[2]) - float(found[1]) > 0.99 * (ef.high - ef.low) - 0.2
    readouts = clinical_readouts(fitted, sequence)
    ventricle = ventricle_readouts(fitted, sequence, readouts)
    columns = frame_table(fitted, readouts, ventricle).columns
    known = sequence.uncertainty
    assert known is not None
    assert known.volumes is not None
    assert (columns["volume_bound_ml"] >= 1.99 * known.volumes / 1000.0).all()
    row = cohort_table([Recording("one", fitted, readouts)]).columns
    spread = row["ejection_fraction_high_percent"] - row["ejection_fraction_low_percent"]
    assert spread[0] > 0.99 * (ef.high - ef.low)
    header, _ = read_container(View(fitted, sequence).payload())
    share = header["volume"]["share"]
    assert share["high"] - share["low"] > 0.99 * (ef.high - ef.low)
    assert NOTE in json.dumps(header["volume"]["notes"])
    own = strain(sequence)
    assert own.source == known.source
    for name, one in (("gls", "GLS"), ("gcs", "GCS")):
        figure = own.end_systolic[one]
        assert stated[name].high - stated[name].low > 0.99 * (figure.high - figure.low)
