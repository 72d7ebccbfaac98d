"""Signatures and their products: arrays, surfaces, distances."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

from modalmotion.client.answers import SignatureArrays, pack_of
from modalmotion.client.bodies import Source, body_of, json_body
from modalmotion.client.calls import (
    HDF5,
    NPZ,
    Calls,
    require_suffix,
    save,
    sequence_of,
    sequence_path,
)
from modalmotion.client.connection import Answer, Call
from modalmotion.client.errors import understood
from modalmotion.client.jobs import Job
from modalmotion.client.many_files import ZIP, SentResult, signatures_in
from modalmotion.client.query import Option, plain
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress
from modalmotion.signature.comparison import Comparison
from modalmotion.signature.making import ModalSignature

SURFACES: Final = {
    ".npz": NPZ,
    ".vtkhdf": "application/vnd.vtk.vtkhdf",
    ".glb": "model/gltf-binary",
    ".zip": "application/zip",
}
"""Media types of surface files by suffix; a zip holds PLY files."""

# Signatures a request, until the service states its limit.
_AT_ONCE: Final = 1000


class SignatureCalls(Calls):
    """Signatures and their products."""

    def signature(
        self,
        sequence_id: str,
        *,
        progress: Callable[[float], None] | None = None,
        **options: Option,
    ) -> ModalSignature:
        """Return the modal signature of a stored sequence: the library's own, bit for bit.

        Parameters
        ----------
        sequence_id : str
        progress : callable, optional
            Called with the share that is done where a job of the service fits it.
        **options
            As the service names them: modes, kind, topology, grid, reference, weights, components,
            template, apex, base, theta_zero, ...

        Raises
        ------
        NotFoundError
            If the sequence does not exist.
        RemoteError
            If the signature cannot be fitted.
        """
        return self._awaited(_signature(sequence_id, options), _own, progress)

    def start_signature(self, sequence_id: str, **options: Option) -> Job[ModalSignature]:
        """Fit a signature in a job of the service."""
        return self._started(_signature(sequence_id, options), _own)

    def signature_of(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> ModalSignature:
        """Return the modal signature of a sequence sent along; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            Of reading (format, grid, unit, ...) and of the signature (modes, template, ...).
        """
        call = Call("POST", "/v1/signature", options, HDF5, body_of(source), is_repeatable=True)
        return self._sent(call, _own, progress)

    def signatures_of(
        self,
        sources: Mapping[str, Source] | Iterable[Source],
        *,
        manifest: str | None = None,
        progress: Progress | None = None,
        **options: Option,
    ) -> list[SentResult[ModalSignature]]:
        """Return the modal signatures of many sequences sent along; nothing is stored.

        A file that cannot be read or fitted costs no other: it has its own error.

        Parameters
        ----------
        sources : iterable of (path, bytes or MeshSequence), or mapping of str to these
            Any number: they are sent in as few requests as the service allows.
        manifest : str, optional
            CSV with the columns path (the names of the files), subject, label and facts; for
            files that fit into one request.
        progress : callable, optional
            Called with the files that are done, and all.
        **options
            Of reading and of the signatures, as of `signature_of`; of all files.
        """
        return self._of_many(
            ("/v1/signature", ZIP), sources, manifest, signatures_in, progress, options
        )

    def signatures(
        self,
        sequence_ids: Iterable[str],
        *,
        progress: Callable[[float], None] | None = None,
        **options: Option,
    ) -> list[SignatureArrays]:
        """Return the trajectories of many sequences, in the order of their ids.

        Parameters
        ----------
        sequence_ids : iterable of str
            Any number: they are sent in as few requests as the service allows.
        progress : callable, optional
            Called with the share that is done.
        **options
            Of all the signatures.
        """
        ids = list(sequence_ids)
        at_once = _AT_ONCE
        if len(ids) > 1:
            with understood("a list of limits"):
                at_once = max(1, int(self._get("/v1/limits").json.get("query_ids", _AT_ONCE)))
        answers: list[SignatureArrays] = []
        for start in range(0, len(ids), at_once):
            request = {"ids": ids[start : start + at_once], **plain(options)}
            call = Call(
                *("POST", "/v1/signatures/query", None, NPZ),
                body=json_body(request),
                is_repeatable=True,
            )
            answers += self._awaited(call, pack_of)
            if progress is not None:
                progress(len(answers) / len(ids))
        return answers

    def reconstruction(self, sequence_id: str, **options: Option) -> MeshSequence:
        """Return the surfaces that a signature describes.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the signature; and times, in s, phases, shares of the cycle, or frames, so many in
            even steps: those of the recording by default.
        """
        return sequence_of(self._get(sequence_path(sequence_id, "reconstruction"), options, NPZ))

    def save_reconstruction(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write the surfaces that a signature describes: .npz, .vtkhdf, .glb, or .zip of PLY."""
        target = Path(path)
        accept = require_suffix(target, SURFACES)
        save(
            self._get(sequence_path(sequence_id, "reconstruction"), options, accept).content, target
        )

    def distance(self, sequence_id: str, to: str, **options: Option) -> Comparison:
        """Return the distance of a sequence's signature from another's: 0 for the same motion."""
        answer = self._get(sequence_path(sequence_id, "distance"), {**options, "to": to}).json
        with understood("a distance"):
            by_errors = answer["by_errors"]
            return Comparison(
                float(answer["distance"]),
                bool(answer["uses_theta_zero"]),
                None if by_errors is None else float(by_errors),
            )


def _signature(sequence_id: str, options: dict[str, Option]) -> Call:
    return Call("GET", sequence_path(sequence_id, "signature"), options, HDF5)


def _own(answer: Answer) -> ModalSignature:
    from modalmotion.store import signature_from_hdf5

    return signature_from_hdf5(answer.content)
