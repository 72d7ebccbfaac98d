"""Modal signatures: fitting, choosing modes, comparing, superposing, and their trade-off."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.signature.making import modal_signature as modal_signature
    from modalmotion.signature.parameters import SignatureKind as SignatureKind
    from modalmotion.signature.parameters import SignatureParameters as SignatureParameters
    from modalmotion.signature.reconstruction import reconstruct as reconstruct
    from modalmotion.signature.reconstruction import resample as resample
    from modalmotion.signature.tradeoff import MOST_OF_FRONT as MOST_OF_FRONT
    from modalmotion.signature.tradeoff import Branch as Branch
    from modalmotion.signature.tradeoff import Chosen as Chosen
    from modalmotion.signature.tradeoff import Front as Front
    from modalmotion.signature.tradeoff import Price as Price
    from modalmotion.signature.tradeoff import Tradeoff as Tradeoff
    from modalmotion.signature.tradeoff import measure_tradeoff as measure_tradeoff
    from modalmotion.signature.tradeoff import price_of as price_of
    from modalmotion.signature.value import ModalSignature as ModalSignature

__all__, __getattr__, __dir__ = public_list(globals())
