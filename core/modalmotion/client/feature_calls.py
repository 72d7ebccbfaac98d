"""Features of stored sequences as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from modalmotion.client.bodies import json_body
from modalmotion.client.calls import JSON, Calls, require_suffix, save
from modalmotion.client.connection import Answer, Call
from modalmotion.client.errors import understood
from modalmotion.client.model_calls import Case
from modalmotion.client.query import Option, plain

if TYPE_CHECKING:
    from modalmotion.classification import FeatureTable

TABLES: Final = {".csv": "text/csv", ".json": JSON}
"""Media types of tables by suffix."""


class FeatureCalls(Calls):
    """Tables of features."""

    def features(
        self,
        cases: Iterable[Case],
        *,
        covariates: str | Sequence[str] | None = None,
        progress: Callable[[float], None] | None = None,
        **options: Option,
    ) -> FeatureTable:
        """Return the features of stored sequences.

        Parameters
        ----------
        cases : iterable of str or mapping
            Ids of stored sequences, or mappings with the members id, label, subject and
            covariates.
        covariates : "all" or sequence of str, optional
            Covariates that become columns.
        progress : callable, optional
            Called with the share that is done where a job of the service makes the table.
        **options
            modes, topology, kind, timing, and on_error: "leave out" goes on
            without sequences that do not fit.

        Raises
        ------
        RemoteError
            If the sequences do not compare, or have not the features that are named.
        """
        return self._awaited(_call(cases, covariates, options, JSON), _table, progress)

    def save_features(
        self,
        cases: Iterable[Case],
        path: str | Path,
        *,
        covariates: str | Sequence[str] | None = None,
        **options: Option,
    ) -> None:
        """Write the features of stored sequences to .csv or .json: see `features`."""
        target = Path(path)
        accept = require_suffix(target, TABLES)
        answer = self._awaited(_call(cases, covariates, options, accept), lambda answer: answer)
        save(answer.content, target)


def _call(
    cases: Iterable[Case],
    covariates: str | Sequence[str] | None,
    options: Mapping[str, Option],
    accept: str,
) -> Call:
    request: dict[str, Any] = {
        "sequences": [case if isinstance(case, str) else dict(case) for case in cases],
        **plain(options),
    }
    if covariates is not None:
        request["covariates"] = covariates if isinstance(covariates, str) else list(covariates)
    return Call(
        *("POST", "/v1/features", None, accept), body=json_body(request), is_repeatable=True
    )


def _table(answer: Answer) -> FeatureTable:
    from modalmotion.classification import FeatureTable

    with understood("a table of features"):
        return FeatureTable.from_json(answer.json)
