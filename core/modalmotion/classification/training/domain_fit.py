"""The domain, fitted to some cases of a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.model.domain import Domain, domain_shape
from modalmotion.classification.training.readings import best_readings
from modalmotion.classification.training.table import CaseTable


@dataclass(frozen=True, eq=False)
class DomainFit:
    """A domain without limits, and all cases as it sees them.

    Parameters
    ----------
    domain : Domain
    kinds : (all cases, readings, columns) float64
        See `kind_of`.
    """

    domain: Domain
    kinds: NDArray[np.float64]

    def nearest(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Give the reading of each case that is nearest to a class, and its distance."""
        kinds = self.kinds[rows]
        n, n_readings, d = kinds.shape
        apart = self.domain.distance(kinds.reshape(-1, d)).reshape(n, n_readings)
        readings = apart.argmin(axis=1)
        return readings, apart[np.arange(n), readings]


def fit_domain(table: CaseTable, rows: NDArray[np.int64]) -> DomainFit:
    """Fit a domain to some cases."""
    reader, y, n_classes = table.domain_reader, table.y[rows], len(table.classes)
    values = table.features(reader)
    X = best_readings(values[rows], y, n_classes)
    own = table.kinds(reader, X[:, None], rows)[:, 0]
    middle, spread = own.mean(axis=0), own.std(axis=0)
    spread = np.where(spread > 1e-12 * np.abs(own).max(axis=0), spread, np.inf)
    means, whitening = domain_shape((own - middle) / spread, y, n_classes)
    # Distances are of kinds as they are, not standardised: (k - middle) / spread - mean.
    means = middle + means * np.where(np.isfinite(spread), spread, 0.0)
    domain = Domain(reader, means, whitening / spread[:, None], np.inf, 0.0, 0.0)
    return DomainFit(domain, table.kinds(reader, values, np.arange(len(table))))
