"""A cohort from its list of files to its folder of signatures."""

from __future__ import annotations

import hashlib
import time
from array import array
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

from modalmotion.errors import ModalMotionError, NotFoundError, ParameterError
from modalmotion.facts import Facts
from modalmotion.modes.topology import MESH, SPHERE
from modalmotion.progress import Progress
from modalmotion.representation import csv_text
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import ResultStore, StagedSignature, write_atomic
from modalmotion.store.index.cursor import now
from modalmotion_service.cohort.batch import Item, Refused, Signed, sign_batch
from modalmotion_service.cohort.job import CohortJob, CohortReport
from modalmotion_service.cohort.ledger import Done, Ledger, stamp_of, with_landmarks
from modalmotion_service.cohort.manifest import Entry
from modalmotion_service.cohort.remote import RemoteFile, Source
from modalmotion_service.cohort.remote_systems import stamps
from modalmotion_service.errors import ClusterError
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.tasks.templates import make_template
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.spool import Spool

MOST_IN_BATCH = 16
# Batches per worker, the running one included, so that it is never idle.
_AHEAD = 2
# Share of each worker's remaining files in the next batch: batches get smaller towards the end,
# so that all workers finish at the same time.
_SHARE = 0.5


def sign_cohort(
    job: CohortJob,
    open_engine: Callable[[Path], Engine],
    progress: Progress = lambda _done, _total: None,
) -> CohortReport:
    """Make the missing signatures of a cohort.

    Parameters
    ----------
    job : CohortJob
    open_engine : callable
        Opens the engine for the folder that workers write to.
    progress : callable
        Called with (files done, files in all).

    Raises
    ------
    ParameterError
        If the folder is a service's, whose uploads under way lie where a cohort's files would.
    StoreError
        If the folder cannot be used, or written to.
    ClusterError
        If the scheduler is lost for longer than `patience_seconds`. Finished files stay.
    """
    start = time.monotonic()
    folder = job.folder.absolute()
    if (folder / "access").is_dir() or (folder / "owners").is_dir():
        raise ParameterError(
            f"'{folder.name}' is the data folder of a service.",
            remedy="Name a folder of its own for the cohort's results.",
        )
    with ResultStore(folder, keep_uploads=job.keep_vertices) as store:
        spool = Spool(folder / "spool")
        spool.clear(keep=set())
        with open_engine(spool.folder) as engine:
            run = _Run(job, store, spool, engine, progress)
            try:
                run.finish()
            except BaseException:
                engine.shutdown(cancel_futures=True)
                raise
            finally:
                spool.clear(keep={"cluster"})
        run.write_table(folder / "cohort.csv")
    failures = [(e.path, run.failures[e.path]) for e in job.entries if e.path in run.failures]
    return CohortReport(run.n_made, run.n_known, tuple(failures), time.monotonic() - start)


class _Run:
    def __init__(
        self, job: CohortJob, store: ResultStore, spool: Spool, engine: Engine, progress: Progress
    ) -> None:
        self._job = job
        self._store = store
        self._spool = spool
        self._engine = engine
        self._progress = progress
        self._ledger = Ledger(store.root)
        self._template, self._parameters = self._make_template()
        settings = repr((astuple(job.options), self._parameters.key))
        self._settings = hashlib.sha256(settings.encode()).hexdigest()[:16]
        # Whether recordings are fitted as others of their mesh are: see `_odd_ones`.
        self._springs = False
        self._kinds: dict[str, list[Entry]] = {}
        self.n_made = 0
        self.n_known = 0
        self.failures: dict[Source, str] = {}
        # A place in the ledger for each file: what is done takes no more memory than what is not.
        self._numbers = {entry.path: number for number, entry in enumerate(job.entries)}
        self._places = array("q", [-1]) * len(job.entries)
        self._keys: dict[Source, str] = {}
        self._facts: dict[Source, Facts] = {}
        self._waiting: deque[Entry] = deque()
        self._suspects: deque[Entry] = deque()
        self._running: dict[Future[Any], tuple[tuple[Entry, ...], tuple[Item, ...]]] = {}
        self._stamps: dict[Source, str] = {}
        self._lost_since: float | None = None

    def finish(self) -> None:
        """Process all files that are not done yet."""
        paths = (entry.path for entry in self._job.entries)
        elsewhere = stamps(path for path in paths if isinstance(path, RemoteFile))
        self._stamps.update((file, text) for file, text in elsewhere.items())
        self._waiting.extend(entry for entry in self._job.entries if not self._is_known(entry))
        self._ledger.forget_earlier()
        self._sign()
        odd = self._odd_ones()
        if odd:
            self._springs = True
            self._parameters = replace(self._parameters, closed_form=False)
            for entry in odd:
                self._places[self._numbers[entry.path]] = -1
                if self._keys.pop(entry.path, None) is None:
                    self.n_made -= 1
                else:
                    self.n_known -= 1
            self._waiting.extend(entry for entry in odd if not self._is_known(entry))
            self._sign()

    def _odd_ones(self) -> list[Entry]:
        """Find closed surfaces taken for spheres, of a mesh of which others have springs by shape.

        So all recordings of one mesh have modes that compare, whichever came first.
        """
        kinds = self._kinds
        meshes = sorted(kind.split()[1] for kind in kinds if kind.startswith(MESH))
        return [one for mesh in meshes for one in kinds.get(f"{SPHERE.name} {mesh}", [])]

    def _sign(self) -> None:
        """Process what waits."""
        self._show()
        while self._waiting or self._suspects or self._running:
            self._submit()
            done, _ = wait(self._running, timeout=1.0, return_when=FIRST_COMPLETED)
            for future in done:
                self._take(future)
            self._show()

    def write_table(self, path: Path) -> None:
        """List all files with their outcomes, for spreadsheets and scripts."""
        lines: list[list[object]] = [
            [
                *("path", "subject", "label", "sequence_id", "signature"),
                *("rms_error", "weighted_rms_error", "unit", "error"),
            ]
        ]
        for entry in self._job.entries:
            names = [entry.path, entry.subject or "", entry.label or ""]
            place = self._places[self._numbers[entry.path]]
            if place < 0:
                lines.append([*names, "", "", "", "", "", self.failures.get(entry.path, "")])
                continue
            done = self._ledger.at(place)
            key = self._keys.get(entry.path, done.key)
            signature = self._store.signature_path(done.sequence_id, key)
            file = signature.relative_to(self._store.root).as_posix()
            lines.append(
                [
                    *names,
                    done.sequence_id,
                    file,
                    f"{done.rms_error:.6g}",
                    f"{done.weighted_rms_error:.6g}",
                    done.unit or "",
                    "",
                ]
            )
        write_atomic(path, csv_text(lines, "\r\n").encode())

    def _make_template(self) -> tuple[Path | None, SignatureParameters]:
        if self._job.template_from is None:
            return None, self._job.parameters
        image = self._spool.new_path()
        source = Upload(self._job.template_from.absolute(), self._job.options)
        work = self._engine.submit(make_template, source, self._job.parameters, image)
        answer, _ = work.result()
        self._store.put_template_image(image, answer.id)
        path = self._store.template_path(answer.id)
        return path, replace(self._job.parameters, template=answer.id)

    def _is_known(self, entry: Entry) -> bool:
        try:
            if isinstance(entry.path, Path):
                stamp = stamp_of(entry.path, entry.facts.landmarks)
            else:
                stamp = with_landmarks(self._stamps.get(entry.path, ""), entry.facts.landmarks)
        except OSError:
            # A worker tries to read it, and says why it cannot.
            stamp = ""
        self._stamps[entry.path] = stamp
        place = self._ledger.find(entry.path, stamp, self._settings, springs=self._springs)
        if place is None or not stamp:
            return False
        done = self._ledger.at(place)
        try:
            record = self._store.sequence_record(done.sequence_id)
            facts = entry.facts.over(record.facts)
            self._facts[entry.path] = facts
            parameters = self._parameters.with_facts(facts, record.topology, record.grid)
            self._store.signature_path(done.sequence_id, parameters.key)
        except NotFoundError:
            return False
        if self._job.keep_vertices and not record.has_upload:
            return False
        self._name(entry, done.sequence_id)
        self._keys[entry.path] = parameters.key
        self._places[self._numbers[entry.path]] = place
        self._note_kind(entry, done.kind)
        self.n_known += 1
        return True

    def _name(self, entry: Entry, sequence_id: str) -> None:
        """Update the record from the manifest."""
        record = self._store.sequence_record(sequence_id)
        stated = {"subject": entry.subject, "label": entry.label}
        changed: dict[str, Any] = {
            name: text
            for name, text in stated.items()
            if text is not None and text != getattr(record, name)
        }
        if entry.facts.over(record.facts) != record.facts:
            changed["change"] = entry.facts.over
        if changed:
            self._store.update_sequence(sequence_id, **changed)

    def _submit(self) -> None:
        if self._lost_since is not None:
            waited = time.monotonic() - self._lost_since
            try:
                self._engine.require_ready()
            except ClusterError as error:
                if waited > self._job.patience_seconds:
                    raise self._lost_scheduler(error) from error
                time.sleep(0.2)
                return
            if waited > self._job.patience_seconds:
                raise self._lost_scheduler(ClusterError("The workers do not finish anything."))
        while len(self._running) < _AHEAD * self._engine.n_workers:
            entries = self._next_batch()
            if not entries:
                return
            items = tuple(self._item(entry) for entry in entries)
            how = self._job.options, self._parameters, self._template, self._job.max_file_bytes
            future = self._engine.submit(sign_batch, items, *how)
            self._running[future] = entries, items

    def _next_batch(self) -> tuple[Entry, ...]:
        if not self._waiting:
            return (self._suspects.popleft(),) if self._suspects else ()
        n_waiting = len(self._waiting)
        size = self._job.batch or batch_size(n_waiting, self._engine.n_workers)
        return tuple(self._waiting.popleft() for _ in range(min(size, n_waiting)))

    def _item(self, entry: Entry) -> Item:
        return Item(
            path=entry.path,
            subject=entry.subject,
            label=entry.label,
            facts=self._facts.get(entry.path, entry.facts),
            created=now(),
            made=self._spool.new_path(),
            keeps_vertices=self._job.keep_vertices,
        )

    def _take(self, future: Future[Any]) -> None:
        entries, items = self._running.pop(future)
        error = future.exception()
        if error is None:
            self._lost_since = None
            self._keep(entries, items, future.result())
        elif isinstance(error, ClusterError):
            self._lost_since = self._lost_since or time.monotonic()
            self._waiting.extendleft(reversed(entries))
            time.sleep(0.1)
        elif len(entries) > 1:
            # One of them broke its worker, or a limit of the batch: each is tried alone.
            self._suspects.extend(entries)
        elif isinstance(error, ModalMotionError):
            self.failures[entries[0].path] = str(error)
        else:
            self.failures[entries[0].path] = f"{type(error).__name__}: {error}"

    def _keep(
        self,
        entries: tuple[Entry, ...],
        items: tuple[Item, ...],
        outcomes: list[Signed | Refused],
    ) -> None:
        signed: list[tuple[Entry, Item, Signed]] = []
        for entry, item, outcome in zip(entries, items, outcomes, strict=True):
            if isinstance(outcome, Refused):
                self.failures[entry.path] = outcome.reason
            else:
                signed.append((entry, item, outcome))
        are_new = self._store.put_staged(
            [
                StagedSignature(
                    one.record, item.record_file, one.key, item.signature, item.vertices
                )
                for _, item, one in signed
            ]
        )
        lines = []
        for (entry, item, one), is_new in zip(signed, are_new, strict=True):
            if not is_new:
                self._name(entry, one.record.id)
                item.remove_files()
            done = Done(
                str(entry.path),
                self._stamps[entry.path],
                self._settings,
                one.record.id,
                one.rms_error,
                one.weighted_rms_error,
                one.record.unit,
                one.key,
                one.kind,
                self._springs,
            )
            lines.append(done)
        places = self._ledger.add(*lines)
        for (entry, _, one), place in zip(signed, places, strict=True):
            self._places[self._numbers[entry.path]] = place
            self._note_kind(entry, one.kind)
        self.n_made += len(lines)

    def _note_kind(self, entry: Entry, kind: str) -> None:
        if kind:
            self._kinds.setdefault(kind, []).append(entry)

    def _show(self) -> None:
        done = self.n_made + self.n_known + len(self.failures)
        self._progress(done, len(self._job.entries))

    def _lost_scheduler(self, error: ModalMotionError) -> ClusterError:
        n_done = self.n_made + self.n_known
        return ClusterError(
            f"{error.message} {n_done} of {len(self._job.entries)} files are done and kept.",
            remedy="When there is a scheduler with workers again, run the same command again: "
            "only unfinished files are processed.",
            details={"done": n_done, "files": len(self._job.entries)},
        )


def batch_size(n_left: int, n_workers: int) -> int:
    """Files in the next piece of work: few enough that all workers end at about the same time."""
    return max(1, min(MOST_IN_BATCH, int(_SHARE * n_left / n_workers)))
