"""A model that reads and scores its members together answers as member by member."""

from __future__ import annotations

import gc
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import _lru_cache_wrapper

import numpy as np
import pytest

from modalmotion.classification import DEFAULT_MODEL, Model, classify, load_model
from modalmotion.classification.estimators.scorer import Blend, Scorer, pooled
from modalmotion.classification.estimators.temperature import softmax
from modalmotion.classification.features import (
    Column,
    Columns,
    FeatureReader,
    Further,
    KnownFeatures,
    covariate_columns,
    mean_motion,
    motion_of,
)
from modalmotion.classification.features.patterns import learn_patterns
from modalmotion.classification.model.member import Member
from modalmotion.facts import Facts
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle

ALL_BESIDE = (Further.SIZE, Further.REST_SHAPE, Further.VOLUME, Further.VOLUME_CURVE)
AGES = covariate_columns([{"age": 50.0, "sex": "f"}, {"age": 61.0, "sex": "m"}, {"age": 70.0}])


def signatures() -> list[ModalSignature]:
    parameters = SignatureParameters(modes=18, reference="mean", volumes=True)
    found = []
    for seed, n_frames in ((4, 16), (5, 25), (6, 9)):
        beat = simulate_ventricle(
            grid=(12, 24),
            acquisition=Acquisition(n_frames=n_frames, noise=0.3),
            rng=np.random.default_rng(seed),
        )
        signature = modal_signature(beat, parameters)
        facts = Facts(covariates={"age": 55.0 + seed, "sex": "f"}).over(signature.facts)
        found.append(replace(signature, facts=facts))
    return found


SIGNATURES = signatures()


def readers() -> list[FeatureReader]:
    axis = FeatureReader(True, True, 2, False, n_modes=7)
    modes = FeatureReader(False, True, 2, False, n_modes=7)
    course = FeatureReader(False, False, 4, True, n_modes=7)
    found = [
        axis,
        replace(axis, further=ALL_BESIDE),
        replace(axis, n_modes=13, further=(Further.SIZE,)),
        replace(axis, walls=True, n_modes=0),
        replace(axis, adds_modes=True),
        modes,
        replace(modes, further=ALL_BESIDE),
        replace(modes, is_brief=True, n_modes=12),
        replace(course, further=(Further.VOLUME_CURVE,)),
        replace(course, n_harmonics=2, n_modes=0),
        replace(course, is_brief=True),
        replace(modes, reads_motion=False, further=(Further.COVARIATES,), covariates=AGES),
        replace(axis, further=(Further.VOLUME, Further.COVARIATES), covariates=AGES),
    ]
    for one in (replace(modes, walls=True), course):
        terms = [motion_of(s, replace(one, n_modes=0)).terms[:, :7] for s in SIGNATURES]
        typical = mean_motion(terms, is_cycle=one.is_cycle)
        found += [
            replace(one, typical=typical),
            replace(one, typical=typical.copy(), further=(Further.SIZE,)),
            replace(one, typical=np.zeros_like(typical)),
        ]
    shares = np.stack([motion_of(s, course).shares.terms[:, :7].real for s in SIGNATURES])
    return [*found, replace(course, patterns=learn_patterns(shares, np.array([0, 0, 1]), 0))]


def model_of(kinds: list[FeatureReader]) -> Model:
    """Give the shipped model other members, whose scorers say anything."""
    rng, shipped = np.random.default_rng(0), load_model(DEFAULT_MODEL)
    n_classes = len(shipped.classes)
    members = []
    for reader in kinds:
        X = np.stack([reader.read(signature).values[0] for signature in SIGNATURES])
        scale = np.where(X.std(axis=0) > 1e-9, X.std(axis=0), np.inf)
        anchors = (X - X.mean(axis=0)) / scale
        d = X.shape[1]
        scorers = tuple(
            Scorer(rows, gamma, rng.normal(size=(n, n_classes)), rng.normal(size=n_classes), 1.3)
            for rows, gamma, n in ((np.zeros((0, d)), 0.0, d), (anchors, 0.3 / d, len(anchors)))
        )
        blend = Blend(X.mean(axis=0), scale, scorers, 0.9)
        columns = tuple(reader.columns(SIGNATURES[0]))
        members.append(Member(reader, columns, blend, b"", 1.0 / len(kinds)))
    return replace(shipped, members=tuple(members), temperature=0.8)


MODEL = model_of(readers())


@pytest.mark.parametrize("signature", SIGNATURES)
def test_members_read_together_as_each_alone(signature: ModalSignature) -> None:
    together = MODEL.read(signature)
    place = 0
    for member in MODEL.members:
        alone = member.reader.read(signature)
        found = together.values[:, place : place + alone.values.shape[1]]
        # Roots of what is not there are those of rounding.
        expected = np.broadcast_to(alone.values, found.shape)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-7)
        assert tuple(alone.columns) == member.columns
        place += alone.values.shape[1]
    assert place == together.values.shape[1]


@pytest.mark.parametrize("signature", SIGNATURES)
def test_members_score_together_as_each_alone(signature: ModalSignature) -> None:
    values = MODEL.read(signature).values
    ends = np.cumsum([len(member.columns) for member in MODEL.members])[:-1]
    logs = [
        member.log_shares(part)
        for member, part in zip(MODEL.members, np.split(values, ends, axis=1), strict=True)
    ]
    weights = [member.weight for member in MODEL.members]
    expected = softmax(pooled(logs, weights) / MODEL.temperature)
    np.testing.assert_allclose(MODEL.probabilities(values), expected, rtol=1e-9, atol=1e-12)
    # Kernels of the same anchors are one family.
    assert MODEL._pool is not None
    assert len(MODEL._pool.families) < len(MODEL.members)


def test_what_was_read_of_one_signature_is_not_taken_for_another() -> None:
    first, second = SIGNATURES[:2]
    before = MODEL.read(first).values
    MODEL.read(second)
    assert np.array_equal(MODEL.read(first).values, before)
    known = KnownFeatures()
    assert np.array_equal(MODEL.read(first, known).values, MODEL.read(first, known).values)


def test_readers_that_learned_the_same_share_it_and_others_do_not() -> None:
    course = next(r for r in readers() if r.typical is not None and not r.is_cycle)
    typical = course.typical
    assert typical is not None
    same = replace(course, typical=typical.copy())
    other = replace(course, typical=2.0 * typical)
    assert same.motion_key == course.motion_key
    assert other.motion_key != course.motion_key
    assert replace(course, patterns=readers()[-1].patterns).motion_key != course.motion_key


def test_threads_answer_as_one_after_another() -> None:
    shipped = load_model(DEFAULT_MODEL)
    beats = [
        modal_signature(
            simulate_ventricle(rng=np.random.default_rng(seed)), shipped.signature_parameters
        )
        for seed in range(4)
    ] * 8
    # Fresh models, of which nothing is known yet.
    one, other = (replace(shipped, domain=replace(shipped.domain)) for _ in range(2))
    expected = [classify(beat, one) for beat in beats]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda beat: classify(beat, other), beats))
    for a, b in zip(expected, found, strict=True):
        assert (a.label, a.class_set, a.flags, a.notes) == (b.label, b.class_set, b.flags, b.notes)
        assert np.array_equal(a.probabilities, b.probabilities)
        assert [part.score for part in a.explanation] == [part.score for part in b.explanation]


def test_what_is_kept_is_bounded() -> None:
    for signature in SIGNATURES:
        MODEL.read(signature)
    assert len(MODEL._kept_places) == 1
    kept = [
        one
        for one in gc.get_objects()
        if isinstance(one, _lru_cache_wrapper)
        and one.__module__.startswith("modalmotion.classification")
    ]
    assert len(kept) > 10
    unbounded = [one for one in kept if one.cache_parameters()["maxsize"] is None]
    # The shipped models, by their names.
    assert {one.__module__ for one in unbounded} <= {"modalmotion.classification.model.shipped"}


def test_columns_are_tuples_that_know_their_hash() -> None:
    plain = (Column("a", (0,)), Column("b", (1, 2), 0.5))
    columns = Columns(plain)
    assert tuple(columns) == plain
    assert hash(columns) == hash(plain)
    assert columns.powers.tolist() == [1.0, 0.5]
    again = pickle.loads(pickle.dumps(columns))  # noqa: S301 (our own)
    assert again == columns
    assert isinstance(again, Columns)
    assert "_hash" not in vars(again)
