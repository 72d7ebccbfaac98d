"""Prices of tasks, before their files are read."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from modalmotion.exports.signature_pack import SurfaceFormat
from modalmotion.formats import Format, ReadOptions, write_npz
from modalmotion.mesh import NO_FACTS
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import reading_seconds, signature_seconds
from modalmotion.simulate import simulate_ventricle
from modalmotion.store import SequenceRecord
from modalmotion_service.http.negotiation import JSON, NPZ, PNG
from modalmotion_service.schemas.queries import ModesRequest
from modalmotion_service.schemas.requests import EncodingTarget
from modalmotion_service.work.engine import SHORT_SECONDS
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.work.tasks import sequences, signatures
from modalmotion_service.work.tasks.files import Fitted
from modalmotion_service.work.upload import Upload

TARIFF = Tariff("a", 20.0, 2.0)
USUAL = SignatureParameters()
NOWHERE = Path("/nowhere/at-all")


def file_of(folder: Path, n_bytes: int) -> Path:
    path = folder / f"{n_bytes}.raw"
    path.write_bytes(bytes(n_bytes))
    return path


def price(task: Callable[..., Any], *args: Any) -> float:
    return TARIFF.terms(task, args).price


def upload(folder: Path, n_bytes: int, kind: Format | None = Format.RAW) -> Upload:
    return Upload(file_of(folder, n_bytes), ReadOptions(format=kind))


def test_what_nobody_knows_is_long_work_without_end() -> None:
    terms = TARIFF.terms(abs, (-1,))
    assert terms.owner == "a"
    assert terms.price == terms.most_seconds == math.inf


def test_a_mesh_whose_modes_are_solved_for_has_the_means_for_it(tmp_path: Path) -> None:
    """300 modes of 1,820 vertices in many parts, 225 kB compressed, take 4 s of processor time."""
    many = SignatureParameters(modes=300)
    sent = upload(tmp_path, 225_000)
    terms = TARIFF.terms(signatures.sign_upload, (sent, many, None, JSON))
    assert terms.price < 1.0
    assert terms.most_seconds > 10 * 4.0
    stated = SignatureParameters(modes=300, topology="mesh")
    assert price(signatures.sign_upload, sent, stated, None, JSON) > 1.0
    # The usual request keeps the usual means.
    assert TARIFF.terms(signatures.sign_upload, (sent, USUAL, None, JSON)).most_seconds == 2.0


def test_prices_rise_with_the_size_of_the_file(tmp_path: Path) -> None:
    sizes = (1_000, 100_000, 10_000_000)
    out = NOWHERE
    makers: list[Callable[[int], float]] = [
        lambda n: price(sequences.ingest, upload(tmp_path, n), out),
        lambda n: price(signatures.sign_upload, upload(tmp_path, n), USUAL, None, JSON),
        lambda n: price(signatures.sign, file_of(tmp_path, n), USUAL, None, None, out),
        lambda n: price(
            sequences.encode_sequence, upload(tmp_path, n), EncodingTarget(rms=1), out, out
        ),
        lambda n: price(sequences.decode_upload, file_of(tmp_path, n), None, None, NPZ, out),
        lambda n: price(signatures.read_out, file_of(tmp_path, n), NOWHERE, None, JSON),
    ]
    for make in makers:
        prices = [make(n) for n in sizes]
        assert prices == sorted(prices)
        assert prices[2] > 5 * prices[0]


def test_a_small_signature_is_short_work_and_a_large_one_is_not(tmp_path: Path) -> None:
    def signed(n_bytes: int, parameters: SignatureParameters, media_type: str = JSON) -> float:
        return price(
            signatures.sign_upload, upload(tmp_path, n_bytes), parameters, None, media_type
        )

    assert signed(100_000, USUAL) < SHORT_SECONDS
    assert signed(20_000_000, USUAL) > SHORT_SECONDS
    # Whatever asks for more than a few modes of a larger mesh, for a search, or for a picture.
    assert signed(1_000_000, SignatureParameters(modes=1000)) > SHORT_SECONDS
    assert signed(1_000_000, SignatureParameters(tolerance=0.01)) > SHORT_SECONDS
    assert signed(100_000, SignatureParameters(auto=True)) > SHORT_SECONDS
    assert signed(100_000, SignatureParameters(deviations=True)) > SHORT_SECONDS
    assert signed(100_000, USUAL, PNG) > SHORT_SECONDS


def test_text_is_dearer_than_arrays(tmp_path: Path) -> None:
    text = tmp_path / "text"
    text.write_bytes(b"ply\nformat ascii 1.0\n" + b"0 0 0\n" * 20_000)
    sent = Upload(text, ReadOptions())
    arrays = Upload(text, ReadOptions(format=Format.NPZ))
    assert price(sequences.ingest, sent, NOWHERE) > 5 * price(sequences.ingest, arrays, NOWHERE)
    assert reading_seconds(10**6, Format.ZIP) > 5 * reading_seconds(10**6)


def test_modes_surfaces_and_pictures_cost_what_they_take(tmp_path: Path) -> None:
    file = file_of(tmp_path, 1_000_000)
    few, many = (
        price(sequences.modes_of_template, file, ModesRequest(modes=n), NPZ) for n in (7, 700)
    )
    assert many > 10 * few
    kept = Fitted(file, file, None, None, cast("SequenceRecord", None))
    usual = (kept, SurfaceFormat.NPZ)
    own, more = (
        price(signatures.superpose, *usual, t, None, NOWHERE) for t in (None, [0.0] * 5000)
    )
    assert more > 2 * own
    trade = (file, USUAL, 111, None, None)
    assert price(signatures.measure_trade, *trade, JSON, NOWHERE, NO_FACTS) > 10 * price(
        signatures.sign, file, USUAL, None, None, NOWHERE
    )


def test_what_is_still_to_be_written_has_no_size() -> None:
    assert price(sequences.ingest, Upload(NOWHERE, ReadOptions()), NOWHERE) < SHORT_SECONDS


@pytest.mark.parametrize("grid", [(16, 16), (32, 64)])
@pytest.mark.parametrize("modes", [7, 60])
def test_an_honest_file_takes_no_more_than_a_few_times_its_price(
    tmp_path: Path, grid: tuple[int, int], modes: int
) -> None:
    data = write_npz(simulate_ventricle(grid=grid, rng=np.random.default_rng(1)))
    path = tmp_path / "file"
    path.write_bytes(data)
    sent, parameters = Upload(path, ReadOptions()), SignatureParameters(modes=modes)
    signatures.sign_upload(sent, parameters, None, JSON)
    spent = []
    for _ in range(5):
        start = time.process_time()
        signatures.sign_upload(sent, parameters, None, JSON)
        spent.append(time.process_time() - start)
    assert min(spent) < 4 * signature_seconds(len(data), parameters)
    assert TARIFF.terms(signatures.sign_upload, (sent, parameters, None, JSON)).most_seconds >= 2
