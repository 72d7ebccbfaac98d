"""Speed for accuracy: cost and error of each choice, measured on the sequence itself."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.tradeoff.answer import Tradeoff, measure_tradeoff
from modalmotion.tradeoff.chosen import Chosen
from modalmotion.tradeoff.front import MOST_OF_FRONT, Branch, Front, measure_front
from modalmotion.tradeoff.price import Price, price_of

__all__ = [
    "MOST_OF_FRONT",
    "Branch",
    "Chosen",
    "Front",
    "Price",
    "Tradeoff",
    "measure_front",
    "measure_tradeoff",
    "price_of",
]

check_arguments(globals())
