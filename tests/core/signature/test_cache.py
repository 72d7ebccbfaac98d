"""Templates that were made before."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from template_surfaces import make_ventricle

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.basis import TemplateCache
from modalmotion.template import Template, make_template


def sequence_of(seed: int, n: int = 120) -> MeshSequence:
    return mesh_sequence(*make_ventricle(n, np.random.default_rng(seed)))


def test_bases_are_kept_by_template_and_count() -> None:
    cache = TemplateCache()
    one, other = (make_template(sequence_of(k)) for k in (0, 1))
    assert cache.basis(one, 7) is cache.basis(one, 7)
    assert len({id(cache.basis(one, n)) for n in (2, 4, 7)}) == 3
    assert cache.basis(one, 4) is not cache.basis(other, 4)


def test_the_longest_unused_goes_first() -> None:
    cache = TemplateCache(n_templates=2)

    def of(k: int) -> Template:
        return cache.named(f"{k}", lambda: make_template(sequence_of(k)))

    one, other = of(0), of(1)
    assert of(0) is one
    of(2)
    assert of(0) is one
    assert of(1) is not other


def test_threads_share_it() -> None:
    cache = TemplateCache(n_templates=3)

    def of(k: int) -> str:
        return cache.named(f"{k % 5}", lambda: make_template(sequence_of(k % 5))).id

    with ThreadPoolExecutor(4) as pool:
        ids = list(pool.map(of, range(40)))
    assert [len(set(ids[k::5])) for k in range(5)] == [1] * 5


def test_it_holds_no_more_bytes_than_it_may() -> None:
    one = make_template(sequence_of(0))
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
