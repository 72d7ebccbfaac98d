"""Files that workers write: whole or not there, and nothing stays of a worker that died."""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from access_parts import guarded
from store_samples import sample_sequence
from worker_tasks import die_while_writing

from modalmotion.store import template_to_hdf5
from modalmotion.template import make_template
from modalmotion_service.work.engine import Terms
from modalmotion_service.work.pool import WorkerPool
from modalmotion_service.work.tasks.files import named_template, whole_file, write_whole


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "name"
    with pytest.raises(ZeroDivisionError), whole_file(path) as temporary:  # noqa: PT012
        temporary.write_bytes(b"half")
        assert not path.exists()
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    write_whole(path, b"whole")
    write_whole(path, b"again")
    assert path.read_bytes() == b"again"


def test_nothing_stays_of_a_worker_that_died(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    submit = WorkerPool.submit_for

    def dying(pool: WorkerPool, terms: Terms, task: Any, *args: Any) -> Future[Any]:
        (path,) = [arg for arg in args if isinstance(arg, Path) and not arg.exists()][:1]
        return submit(pool, terms, die_while_writing, path)

    with guarded(tmp_path) as service:
        made = service.ask("lab", "POST", "/v1/sequences", content=beat).headers["location"]
        with monkeypatch.context() as patch:
            patch.setattr(WorkerPool, "submit_for", dying)
            # An image, and an output.
            for what in ("signature", "encoded?rms=0.5"):
                answer = service.ask("lab", "GET", f"{made}/{what}")
                assert answer.json()["code"] == "worker_died"
        assert list((tmp_path / "owners" / "lab" / "spool").iterdir()) == []


def test_a_worker_holds_one_template_at_a_time(tmp_path: Path) -> None:
    held = []
    for number in range(2):
        template = make_template(sample_sequence(number))
        path = tmp_path / f"{template.id}.h5"
        path.write_bytes(template_to_hdf5(template))
        held.append(weakref.ref(named_template(path)))
        assert named_template(path) is held[-1]()
    gc.collect()
    assert held[0]() is None
