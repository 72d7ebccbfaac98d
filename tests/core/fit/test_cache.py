"""Templates that were made before."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from template_surfaces import make_ventricle

from modalmotion.errors import ParameterError
from modalmotion.fit.cache import TemplateCache
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.template import GivenLandmarks, Weights, make_template


def sequence_of(seed: int, n: int = 120) -> MeshSequence:
    return mesh_sequence(*make_ventricle(n, np.random.default_rng(seed)))


def test_the_same_content_gives_the_same_template() -> None:
    cache = TemplateCache()
    one = cache.template(sequence_of(0))
    assert cache.template(sequence_of(0)) is one
    assert cache.basis(one, 7) is cache.basis(one, 7)
    fresh = make_template(sequence_of(0))
    assert fresh.id == one.id
    assert (fresh.coordinates == one.coordinates).all()


def test_other_content_does_not() -> None:
    cache, sequence = TemplateCache(), sequence_of(0)
    found = [
        cache.template(sequence),
        cache.template(sequence, reference=2),
        cache.template(sequence, weights=Weights.UNIFORM),
        cache.template(sequence, landmarks=GivenLandmarks(theta_zero=3)),
        cache.template(sequence, closed_form=False),
        cache.template(sequence_of(1)),
    ]
    assert len({template.id for template in found}) == len(found)
    assert len({id(cache.basis(template, 4)) for template in found}) == len(found)
    assert len({id(cache.basis(found[0], n)) for n in (2, 4, 7)}) == 3


def test_the_longest_unused_goes_first() -> None:
    cache = TemplateCache(n_templates=2)
    one, other = (cache.template(sequence_of(k)) for k in (0, 1))
    assert cache.template(sequence_of(0)) is one
    cache.template(sequence_of(2))
    assert cache.template(sequence_of(0)) is one
    assert cache.template(sequence_of(1)) is not other


def test_errors_are_those_of_making() -> None:
    with pytest.raises(ParameterError, match="counted from 0"):
        TemplateCache().template(sequence_of(0), reference=99)


def test_threads_share_it() -> None:
    cache = TemplateCache(n_templates=3)
    with ThreadPoolExecutor(4) as pool:
        ids = list(pool.map(lambda k: cache.template(sequence_of(k % 5)).id, range(40)))
    assert [len(set(ids[k::5])) for k in range(5)] == [1] * 5


def test_it_holds_no_more_bytes_than_it_may() -> None:
    one = TemplateCache().template(sequence_of(0))
    room_for_one = 4 * one.n_vertices * 7 * 8 + 1
    cache = TemplateCache(most_bytes=room_for_one)
    other = make_template(sequence_of(1))
    kept = cache.basis(one, 7)
    assert cache.basis(one, 7) is kept
    cache.basis(other, 7)
    assert cache.basis(one, 7) is not kept
    # Larger than all the room: made each time, and nothing goes for it.
    kept = cache.basis(one, 7)
    assert cache.basis(other, 18) is not cache.basis(other, 18)
    assert cache.basis(one, 7) is kept


def test_a_named_template_is_loaded_once_and_lattices_are_kept_apart() -> None:
    cache, loaded = TemplateCache(), make_template(sequence_of(0))
    assert cache.named("name", lambda: loaded) is loaded
    assert cache.named("name", lambda: make_template(sequence_of(1))) is loaded
    assert cache.basis(loaded, 7, (8, 16)) is not cache.basis(loaded, 7)
