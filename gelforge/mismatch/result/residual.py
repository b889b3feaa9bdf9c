"""What tests say of residuals, before and after the answer, as verdict.json has it."""

from __future__ import annotations

from pydantic import Field

from gelforge.config import NonNegative, Section
from gelforge.mismatch.result.scores import Probability
from gelforge.mismatch.thresholds import ADEQUATE_P, ALARM_P, LEFT_P


class Mismatch(Section):
    """Whether the nominal model explains the readings."""

    chi2: NonNegative = Field(description="Squared whitened residual, summed [-]")
    degrees: int = Field(ge=0, description="Its number of degrees of freedom [-]")
    p: Probability = Field(description="Of as much by chance [-]")
    scan_p: Probability = Field(description="Of the strongest pattern by chance, looked for everywhere [-]")
    unknown_p: Probability | None = Field(
        None, description="Bound on that of so much evidence for a discrepancy by chance [-]"
    )
    known_p: Probability | None = Field(None, description="Bound on the same for the known effects [-]")

    @property
    def differs(self) -> bool:
        """Return whether a test differs, by itself no alarm."""
        return min(p for p in (self.p, self.scan_p, self.unknown_p, self.known_p) if p is not None) < ALARM_P


class Adequacy(Section):
    """Whether the answer leaves nothing but noise."""

    p: Probability = Field(description="Of what remains, by chance, as the mismatch's p [-]")
    scan_p: Probability = Field(description="Of the strongest remaining pattern by chance [-]")
    remains: str = Field("", description="The strongest remaining pattern, in words")

    @property
    def passed(self) -> bool:
        """Return whether nothing else needs to be there."""
        return min(self.p, self.scan_p) > LEFT_P

    @property
    def words(self) -> str:
        """Return the residual, in words."""
        if not self.passed:
            return "something remains"
        return "only noise remains" if min(self.p, self.scan_p) > ADEQUATE_P else "something small may remain"
