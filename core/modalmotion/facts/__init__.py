"""Facts: statements of the sender about a sequence beside its arrays."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.facts.columns import facts_in, states_fact
from modalmotion.facts.facts import NAMES, NO_FACTS, UNKNOWN, WORDS, Facts
from modalmotion.facts.json_form import facts_as_json, facts_from_json, facts_patched
from modalmotion.facts.named import Named
from modalmotion.facts.places import Corners, Place
from modalmotion.facts.texts import column_of, facts_from_texts, is_fact

__all__ = [
    "NAMES",
    "NO_FACTS",
    "UNKNOWN",
    "WORDS",
    "Corners",
    "Facts",
    "Named",
    "Place",
    "column_of",
    "facts_as_json",
    "facts_from_json",
    "facts_from_texts",
    "facts_in",
    "facts_patched",
    "is_fact",
    "states_fact",
]

check_arguments(globals())
