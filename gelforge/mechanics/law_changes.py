"""Laws made from laws: other exponents at the same modulus, and the law whose stress is linear."""

from __future__ import annotations

from gelforge.mechanics.laws import Gent, MooneyRivlin, NeoHooke, Ogden, PrincipalLaw, Yeoh


def with_exponents(law: PrincipalLaw, factor: float) -> PrincipalLaw:
    """Return the law that stiffens faster by a factor > 0, with the same shear modulus; 1 gives the law itself.

    Ogden's exponents are multiplied (mu_k alpha_k stay); neo-Hooke and Mooney-Rivlin are Ogden's with exponents 2 and -2.
    Yeoh's and Gent's laws see I_1 - 3 multiplied beyond the first order.
    """
    if not factor > 0:
        raise ValueError(f"exponent factor {factor:g}; > 0 is needed")
    if factor == 1:
        return law
    if isinstance(law, NeoHooke):
        law = Ogden((law.mu,), (2.0,))
    elif isinstance(law, MooneyRivlin):
        terms = [(2 * C, a) for C, a in ((law.C10, 2.0), (-law.C01, -2.0)) if C]
        law = Ogden(*zip(*terms))
    if isinstance(law, Ogden):
        return Ogden(tuple(m / factor for m in law.mu), tuple(a * factor for a in law.alpha))
    if isinstance(law, Yeoh):
        return Yeoh(law.C10, law.C20 * factor, law.C30 * factor**2)
    if isinstance(law, Gent):
        return Gent(law.mu, law.Jm / factor)
    raise ValueError(f"{type(law).__name__} has no exponent to change; use Ogden, Yeoh or Gent")


def neo_hookean(law: PrincipalLaw) -> NeoHooke:
    """Return the neo-Hookean law of the same shear modulus: its stress is linear in b, nothing stiffens or softens."""
    return NeoHooke(law.shear_modulus)
