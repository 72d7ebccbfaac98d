"""How long a signature takes, predicted from what is known before its file is read.

A prediction is of the processor time that an honest file of that size takes, on the dear side of
what was measured; docs/decisions/0021-fair-and-bounded-work.md has the measurements.
"""

from __future__ import annotations

from typing import Final

from modalmotion.formats.detect import Format
from modalmotion.signature.parameters import ErrorKind, SignatureParameters

# s for any task, and s for a byte of input: an array is read and laid out, a text is parsed too.
_START: Final = 0.02
_OF_ARRAYS: Final = 5e-8
_OF_TEXTS: Final = 1e-6

# Files that hold arrays as they are, or compressed.
_ARRAYS: Final = (Format.NPZ, Format.HDF5, Format.GLB, Format.RAW, None)

# Factoring m shapes takes m^2 products at each vertex, and a vertex is some 100 bytes of a file
# with some frames. A row of m numbers a vertex costs as much as m + 100 products.
_BYTES_OF_VERTEX: Final = 100
_OF_PRODUCT: Final = 4e-10
_OVERHEAD: Final = 100

# The same where the modes must be solved for: 300 of 1,000, 4,000 and 16,000 vertices took 0.7,
# 3.6 and 18 s, and 300 of 1,820 in many parts 3.7 s.
_OF_SPRING_PRODUCT: Final = 1.5e-8

# Modes that are looked at where their number follows from the data, and how often they are fitted.
_LOOKED_AT: Final = 300
_FITS: Final = 3
_FITS_OF_MAX: Final = 20

# s for a byte, where the noise of the motion is estimated.
_OF_NOISE: Final = 1e-5


def reading_seconds(n_bytes: int, kind: Format | None = None) -> float:
    """Predict the processor time that reading a file and laying coordinates over it takes, in s.

    Parameters
    ----------
    n_bytes : int
    kind : Format, optional
        One that holds arrays by default.
    """
    return _START + n_bytes * (_OF_ARRAYS if kind in _ARRAYS else _OF_TEXTS)


def signature_seconds(
    n_bytes: int, parameters: SignatureParameters, kind: Format | None = None
) -> float:
    """Predict the processor time of a signature, parsing counted, in s.

    Parameters
    ----------
    n_bytes : int
        Of the file that the sequence is in.
    parameters : SignatureParameters
    kind : Format, optional
        Of the file; one that holds arrays by default.
    """
    modes, fits = most_modes(parameters), 1
    if modes != parameters.modes:
        fits = _FITS_OF_MAX if parameters.tolerance_of == ErrorKind.MAX else _FITS
    is_estimated = parameters.auto or parameters.deviations
    noise = _OF_NOISE * n_bytes if is_estimated else 0.0
    springs = 0.0 if parameters.closed_form else spring_seconds(n_bytes, modes)
    fitting = fits * _products(n_bytes, modes) * _OF_PRODUCT
    return reading_seconds(n_bytes, kind) + fitting + noise + springs


def spring_seconds(n_bytes: int, modes: int) -> float:
    """Predict the processor time that solving for the spring modes of a mesh takes, in s.

    A signature takes it where the surface turns out to have no natural coordinates, which is
    known only when its file has been read.

    Parameters
    ----------
    n_bytes : int
        Of the file that the sequence is in.
    modes : int
    """
    return _products(n_bytes, modes) * _OF_SPRING_PRODUCT


def most_modes(parameters: SignatureParameters) -> int:
    """Give the largest number of modes that a request makes necessary to look at."""
    return _LOOKED_AT if parameters.modes is None else parameters.modes


def _products(n_bytes: int, modes: int) -> int:
    n_vertices = max(1, n_bytes // _BYTES_OF_VERTEX)
    # No more modes than vertices.
    modes = min(modes, n_vertices)
    return n_vertices * modes * (modes + _OVERHEAD)
