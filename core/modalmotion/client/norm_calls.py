"""Norms: made of one's own controls, listed, described, deleted; and deviations from them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from modalmotion.client.bodies import json_body
from modalmotion.client.calls import HDF5, Calls, require_place, save, sequence_path
from modalmotion.client.connection import Answer, Call
from modalmotion.client.errors import understood
from modalmotion.client.model_calls import Case
from modalmotion.client.query import Option, plain, segment


class NormCalls(Calls):
    """Norms, and how far sequences lie from them."""

    def make_norm(
        self,
        name: str,
        controls: Iterable[Case],
        *,
        progress: Callable[[float], None] | None = None,
        **options: Option,
    ) -> dict[str, Any]:
        """Make a norm of stored sequences of people who are taken as usual.

        Parameters
        ----------
        name : str
            Of no other norm.
        controls : iterable of str or mapping
            Ids of stored sequences, one of each person; or mappings with the members id, subject
            and covariates.
        progress : callable, optional
            Called with the share that is done, 0 to 1.
        **options
            modes, topology.

        Returns
        -------
        dict
            name, id, n_controls, groups, smallest_level and so on: see `/docs`.

        Raises
        ------
        RemoteError
            If no norm can be made of them.
        """
        body = json_body({"name": name, "sequences": _listed(controls), **plain(options)})
        return self._awaited(Call("POST", "/v1/norms", body=body, is_keyed=True), _object, progress)

    def norms(self) -> list[str]:
        """List the names of all norms."""
        answer = self._get("/v1/norms").json
        with understood("a list of norms"):
            return [str(one["name"]) for one in answer["norms"]]

    def norm(self, name: str) -> dict[str, Any]:
        """Describe a norm, as `make_norm` does."""
        return _object(self._get(_path(name)))

    def save_norm(self, name: str, path: str | Path) -> None:
        """Write a norm to a file, as `norm_from_hdf5` and `modalmotion norm ask` read it."""
        target = Path(path)
        require_place(target)
        save(self._get(_path(name), accept=HDF5).content, target)

    def delete_norm(self, name: str) -> None:
        """Delete a norm; its name is free again."""
        self._connection.send(Call("DELETE", _path(name)))

    def deviation(self, sequence_id: str, norm: str, *, level: float = 0.05) -> dict[str, Any]:
        """Tell how far a stored sequence lies from the controls of a norm.

        Parameters
        ----------
        sequence_id : str
        norm : str
        level : float
            Share of recordings like the controls that may be called a deviation.

        Returns
        -------
        dict
            The members of `modalmotion.norm.Deviation`.

        Raises
        ------
        RemoteError
            If there are too few controls for the level, or it does not compare.
        """
        query: dict[str, Option] = {"norm": norm, "level": level}
        path = sequence_path(sequence_id, "deviations")
        return self._awaited(Call("POST", path, query, is_repeatable=True), _object)

    def cohort_deviation(
        self, sequences: Iterable[Case], norm: str, *, level: float = 0.05
    ) -> dict[str, Any]:
        """Tell how far stored sequences lie from the controls of a norm, each and together.

        Parameters
        ----------
        sequences : iterable of str or mapping
            As for `make_norm`, at least five that are no controls.
        norm : str
        level : float
            Of each, and of the warning.

        Returns
        -------
        dict
            The members of `modalmotion.norm.CohortDeviation`.
        """
        body = json_body({"sequences": _listed(sequences), "level": level})
        call = Call("POST", f"{_path(norm)}/deviations", body=body, is_repeatable=True)
        return self._awaited(call, _object)


def _listed(cases: Iterable[Case]) -> list[str | dict[str, Any]]:
    return [one if isinstance(one, str) else dict(one) for one in cases]


def _path(name: str) -> str:
    return f"/v1/norms/{segment(name)}"


def _object(answer: Answer) -> dict[str, Any]:
    with understood("a norm"):
        return dict(answer.json)
