"""Which covariates say how a case was recorded, told from their names."""

from __future__ import annotations

import re
from typing import Final

# Any of these as a part of the name.
_WORDS: Final = frozenset(
    {
        *("site", "centre", "center", "hospital", "clinic", "institution", "institute"),
        *("device", "scanner", "vendor", "manufacturer", "coil", "tesla", "probe", "transducer"),
        *("camera", "station", "workstation", "machine"),
        *("operator", "reader", "observer", "technician", "technologist", "sonographer"),
        *("radiographer", "annotator", "rater"),
        *("batch", "session", "protocol", "acquisition", "reconstruction", "recon", "kernel"),
        *("software", "firmware", "version", "export", "exported"),
        *("segmentation", "segmented", "imaging", "scanned", "recorded"),
        *("fps", "framerate", "slice", "voxel", "pixel", "bandwidth", "fov", "snr"),
        *("date", "timestamp", "uid", "accession", "filename", "dataset", "scandate"),
    }
)

# Each of these by itself, or beside words such as "id" and "ms".
_ALONE: Final = frozenset(
    {
        *("model", "run", "sequence", "series", "study", "scan", "exam", "examination"),
        *("recording", "image", "file", "folder", "frame", "modality", "lab", "laboratory"),
        *("department", "cohort", "source", "year", "resolution", "spacing", "magnet", "b0"),
        *("tr", "te", "ti", "kv", "kvp", "ma", "mas", "fold", "split", "group"),
    }
)

_BESIDE: Final = frozenset(
    {
        *("id", "no", "nr", "n", "num", "number", "count", "name", "code", "index", "type"),
        *("of", "per", "the", "on", "at", "label", "description", "ms"),
        *("s", "sec", "second", "hz", "mm", "t", "data"),
    }
)

# All words of one of these, in any order.
_TOGETHER: Final = (
    *({"frame", "rate"}, {"frame", "time"}, {"frame", "second"}, {"frame", "interval"}),
    *({"frame", "duration"}, {"sampling", "rate"}, {"sampling", "frequency"}),
    *({"sample", "rate"}, {"temporal", "resolution"}, {"spatial", "resolution"}),
    *({"time", "resolution"}, {"image", "resolution"}, {"plane", "resolution"}),
    *({"field", "strength"}, {"field", "view"}, {"matrix", "size"}, {"image", "quality"}),
    *({"repetition", "time"}, {"echo", "time"}, {"inversion", "time"}, {"trigger", "time"}),
    *({"flip", "angle"}, {"pulse", "sequence"}, {"contrast", "agent"}, {"tube", "voltage"}),
    *({"tube", "current"}, {"year", "scan"}, {"year", "study"}, {"year", "exam"}),
    *({"year", "recording"}, {"time", "scan"}, {"scan", "duration"}, {"scan", "month"}),
)

# A patient's own, whatever stands beside them: "age at acquisition", "birth date", "infarct site".
_OWN: Final = frozenset(
    {
        *("age", "birth", "birthdate", "dob", "death", "diagnosis", "onset", "symptom", "pain"),
        *("surgery", "operation", "treatment", "therapy", "drug", "medication", "dose"),
        *("infarct", "infarction", "lesion", "tumor", "tumour", "scar", "fracture", "pacing"),
        *("implant", "implanted", "assist", "pacemaker", "heart", "blood", "mass", "gravity"),
    }
)

_KNOWN: Final = _WORDS | _ALONE | _BESIDE | _OWN

_CAMEL: Final = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_PART: Final = re.compile(r"[^\W\d_]+")


def is_circumstance(name: str) -> bool:
    """Whether a covariate of this name says how a case was recorded, not whom it is of.

    Parameters
    ----------
    name : str
        Its words may be parted by any sign or by capitals: frame_rate, "Frame rate", FrameRate;
        they may stand in the plural.
    """
    parts = {_singular(part) for part in _PART.findall(_CAMEL.sub(" ", name).casefold())}
    whole = "".join(_PART.findall(name.casefold()))
    if parts & _OWN:
        return False
    return (
        any(_is_word(part) for part in parts)
        or (bool(parts & _ALONE) and parts <= _ALONE | _BESIDE)
        or whole in _ALONE
        or any(together <= parts for together in _TOGETHER)
        # Written as one word: "fieldstrength".
        or any(whole in _joined(together) for together in _TOGETHER)
    )


def _is_word(part: str) -> bool:
    """Whether a part is a word, or one with another behind it, as "siteid"."""
    return part in _WORDS or any(
        part.endswith(end) and part[: -len(end)] in _WORDS for end in ("id", "name", "type")
    )


def _singular(part: str) -> str:
    one = part.removesuffix("s")
    return one if one in _KNOWN and part not in _KNOWN else part


def _joined(together: set[str]) -> set[str]:
    first, second = sorted(together)
    return {first + second, second + first}
