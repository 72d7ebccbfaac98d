"""Features in the form of scikit-learn, which is imported here."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.feature_extraction import DictVectorizer
from sklearn.utils.validation import check_is_fitted

from modalmotion.classification import answer, cohort
from modalmotion.classification.cases import TrainingCase, as_case
from modalmotion.classification.motion import Motion
from modalmotion.classification.motion_features import (
    AXIS,
    SUMMARY,
    TERMS,
    WAVES,
    Extractor,
    kinds_of,
    states_walls,
    timings_of,
)
from modalmotion.classification.options import TrainingOptions
from modalmotion.errors import ParameterError
from modalmotion.representation import Floats
from modalmotion.signature.making import ModalSignature, SignatureParameters
from modalmotion.signature.value import first_modes

KINDS: Final = ("auto", AXIS, SUMMARY, WAVES, TERMS)

ALL: Final = "all"
"""In place of names: every covariate that some case has."""

# A covariate of more words is a name or a remark.
_MOST_WORDS: Final = 20

# Between a covariate and a word that it is: no name contains it.
_WORD: Final = "\0"

Covariates = Mapping[str, float | str]


class SignatureFeatures(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Features of recordings, for a pipeline of scikit-learn.

    `fit` decides from all recordings in which modes they compare, whether they are cycles and
    which features are read; `transform` reads them. Labels play no part, so nothing leaks.

    Parameters
    ----------
    modes : int
        Of the signatures that sequences are fitted with.
    topology : str or None
        Of these signatures; "mesh" for spring modes. None lets the recordings decide together.
    kind : str
        "axis": parts about the axis; "modes": modes and their products; "summary": the same in
        few numbers; "terms": modes and their terms, of a transient; "auto": "axis" where
        all have one over a cycle, else "modes".
    timing : str
        "cycle", "transient" or "auto": cycles where most recordings close.
    covariates : None, "all" or sequence of str
        Covariates that become columns: a number is one, NaN where it is unknown, and each word
        has one. Imputation and scaling are left to the pipeline.

    Attributes
    ----------
    readable_ : Readable
        Modes that the recordings share.
    extractor_ : Extractor

    Notes
    -----
    Columns of one motion are the same however it is turned, moved, scaled in its unit, sampled
    and, as a cycle, started.
    """

    def __init__(
        self,
        modes: int = 7,
        topology: str | None = None,
        kind: str = "auto",
        timing: str = "auto",
        covariates: str | Sequence[str] | None = None,
    ) -> None:
        self.modes = modes
        self.topology = topology
        self.kind = kind
        self.timing = timing
        self.covariates = covariates

    def fit(self, X: Iterable[Any], y: Any = None) -> "SignatureFeatures":
        """Decide which features are read.

        Parameters
        ----------
        X : sequence of ModalSignature, MeshSequence or TrainingCase
            Signatures are read as they are; sequences are fitted.
        y : ignored

        Raises
        ------
        ParameterError
            If there is no recording, an option has no such value, or the recordings have not
            the features that it names.
        UnlikeCasesError
            If their modes do not compare.
        """
        del y
        self._fit(X)
        return self

    def fit_transform(self, X: Iterable[Any], y: Any = None, **_: Any) -> Floats:
        """Fit, and give the features of the same recordings: see `fit` and `transform`."""
        del y
        return self._table(self._fit(X))

    def transform(self, X: Iterable[Any]) -> Floats:
        """Read the features of recordings.

        Parameters
        ----------
        X : sequence of ModalSignature, MeshSequence or TrainingCase
            Sequences are fitted in the modes of `fit`.

        Returns
        -------
        (recordings, features) float64
            Shares of the surface's size, in percent, or of the motion; covariates as they are.

        Raises
        ------
        UnlikeCasesError
            If the modes of one do not compare with those of `fit`.
        """
        check_is_fitted(self)
        read = [answer.signature_in(self.readable_, case.motion, case.name) for case in _cases(X)]
        return self._table(read)

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Names of the columns, (features,) object."""
        del input_features
        check_is_fitted(self)
        covariates = [
            f"covariate {name.replace(_WORD, '=')}" for name in self._words.feature_names_
        ]
        return np.array([*self._names, *covariates], dtype=object)

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Parameters that sequences are fitted with, before their topologies are compared."""
        options = TrainingOptions(modes=self.modes, topology=self.topology, timing=self.timing)
        return options.signature_parameters

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.no_validation = True
        return tags

    def _fit(self, X: Iterable[Any]) -> list[ModalSignature]:
        if self.kind not in KINDS:
            raise ParameterError(
                f"The option 'kind' is {str(self.kind)[:80]!r}.",
                remedy=f"Use one of: {', '.join(KINDS)}.",
                details={"option": "kind"},
            )
        signatures = cohort.alike(_cases(X), self.signature_parameters)[0].signatures
        self.readable_ = cohort.readable_of(signatures)
        motions = [Motion(first_modes(one, self.readable_.n_modes)) for one in signatures]
        self.extractor_ = self._chosen(motions)
        self._names = [column.name for column in self.extractor_.columns(motions[0])]
        covariates = [signature.facts.covariates for signature in signatures]
        self._covariates = _chosen_covariates(covariates, self.covariates)
        self._words = DictVectorizer(separator=_WORD, sparse=False).fit(
            map(self._stated, signatures)
        )
        return signatures

    def _chosen(self, motions: list[Motion]) -> Extractor:
        n, walls = self.readable_.n_modes, states_walls(motions)
        is_cycle = timings_of(motions, self.timing)[0]
        kinds = kinds_of(motions, n, is_cycle=is_cycle, walls=walls)
        kind = (AXIS if AXIS in kinds else WAVES) if self.kind == "auto" else self.kind
        if kind not in kinds:
            needed = "cycles about an axis" if kind == AXIS else "transients whose theta is known"
            raise ParameterError(
                f"The features {kind!r} cannot be computed: they are defined for {needed}.",
                remedy="Use kind='modes', or set the timing, the topology or theta_zero.",
                details={"option": "kind"},
            )
        return Extractor(kind, is_cycle, n, walls)

    def _table(self, signatures: list[ModalSignature]) -> Floats:
        n, stated = self.readable_.n_modes, list(map(self._stated, signatures))
        own = [self.extractor_.values(Motion(first_modes(one, n))) for one in signatures]
        columns = [name.split(_WORD)[0] for name in self._words.feature_names_]
        is_known = [[name in case for name in columns] for case in stated]
        values = np.where(is_known, self._words.transform(stated), np.nan)
        return np.concatenate([np.array(own), values.reshape(len(own), -1)], axis=1)

    def _stated(self, signature: ModalSignature) -> Covariates:
        stated = signature.facts.covariates
        return {name: stated[name] for name in self._covariates if name in stated}


def _cases(X: Iterable[Any]) -> list[TrainingCase]:
    cases = [as_case(item, number) for number, item in enumerate(X)]
    if not cases:
        raise ParameterError("There is no recording to read.", remedy="Give at least one.")
    return cases


def _chosen_covariates(
    cases: Sequence[Covariates], wanted: str | Sequence[str] | None
) -> tuple[str, ...]:
    """Choose covariates; of all of them none that is a name or a remark."""
    known: dict[str, set[str]] = {}
    for case in cases:
        for name, value in case.items():
            known.setdefault(name, set()).update([value] if isinstance(value, str) else [])
    if wanted is None:
        return ()
    if wanted == ALL:
        return tuple(sorted(name for name, words in known.items() if len(words) <= _MOST_WORDS))
    names = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    unknown = [str(name) for name in names if name not in known]
    if unknown:
        raise ParameterError(
            f"No case has the covariate {unknown[0][:80]!r}.",
            remedy=f"Use {ALL!r}, or some of: {', '.join(sorted(known)) or 'there is none'}.",
            details={"covariates": sorted(known)},
        )
    return names
