"""Numbers that decide a verdict, each with its reason: a derivation, a reference, a command, or judgement.

Numbers of a method (meshes, bases of functions, steps of a solver) stand where they are used.
"""

import numpy as np

# --- Priors and evidence
# As likely as not that a careful study has left nothing out (judgement); then one effect has 0.35 and two have 0.12
# (docs/mismatch-method.md).
NULL_PRIOR = 0.5
# Log evidence counts for this share: each effect has a form that is not quite the truth's, and so have the errors allowed
# for it. Of 135 claims of two opened concealed sets 0.4 makes the mean log score largest (-0.27; -0.40 at 1), and of
# those that it leaves above 0.9 79 of 81 are right (docs/mismatch-method.md, `python -m validation claims`).
TEMPERING = 0.4
# Of plausible values: what is left out is known to be small, not how small (judgement).
SCALES = (1.0, 0.3, 0.1)
# By which the form of an effect differs from the truth's, shares of its change, equally likely before the readings. Of
# different models of one physics (validation/checks/form_errors.py) most lie between; softening lies beyond.
FORM_ERRORS = (0.1, 0.2, 0.3)
# Of the change of a defect, and of the way to the next places: it lies up to half a spacing from the places that are tried.
PLACE_ERROR = 0.5
# Of a change of the flow, which is the mean motion's on a coarser mesh: for one sensor the mesh puts it off by 4 to 5 %, the
# search finds 0.94 to 1.02 of it by distance (benchmarks/flow_changes.py); for others it may be twice that.
SEEN_ERROR = 0.2
# Of the same, from region to region, by which particles lie in each: 0.10 to 0.12 of one depth (benchmarks/flow_changes.py).
SCATTERED = 0.1
# Of the pressing force, standard deviation of a discrepancy (judgement); SCALES make it smaller.
PLAUSIBLE = 0.1

# --- Alarm and state
# Of the global test, of the scan, of a discrepancy and of the known effects each: any is an alarm, so at most four in a
# hundred recordings, or materials, of which nothing is missing give a false one. Of 85 SYNTHETIC nulls one does
# (docs/results/verdicts.md).
ALARM_P = 0.01
# Probability of an effect, or of effects of one line, from which it is identified: 83 to 100 % of such claims are right, a
# set each (docs/results/verdicts.md).
SURE = 0.9
# Of what an answer leaves, each of its two tests. Below the first what is left is reported. Below the second nothing is
# identified: right answers come below 0.01 in two of a hundred by chance alone, and effects outside the catalogue that come
# below it do so by far (docs/mismatch-method.md).
ADEQUATE_P, LEFT_P = 0.01, 0.002
NEGLIGIBLE = round(
    1 - SURE, 12
)  # probability below which no effect is solved, and no credible set is reported
# Of an effect's probability, which its credible set holds: the usual level. The set that holds the truth then has one or two
# effects in the median and 3 to 5 at most in nine of ten cases (docs/results/verdicts.md).
CREDIBLE = 0.95
# Probability that nothing is missing, by the tempered evidence of the answer, below which a test at ALARM_P is an alarm: the
# credible set then leaves it out. Chi-square below LEFT_P is an alarm by itself, in 2 of 1,000 recordings by chance: the
# posterior has no model of a misfit without a pattern, such as noise above what is stated.
NOTHING_P = round(1 - CREDIBLE, 12)
# Of the leading credible set; with more the readings are too few: the set that holds the truth has 5 at most in nine of ten
# cases (docs/results/verdicts.md).
MOST_EFFECTS = 8
# On recordings of 4 to 25 sites the largest of a scan's 75 to 230 correlated scores exceeds 3.5 to 3.7 by chance in 2.5 %,
# so a change of 4 standard deviations is seen in about three of four cases, one of 2 hardly ever
# (tests/mismatch/test_identifiability.py).
DETECTED_SNR = 4.0
# Of a plausible value. The expected log evidence is at most SNR^2 / 2, here 1/8: evidence below 1 is not worth more than a
# bare mention (Kass and Raftery 1995).
OBSERVABLE_SNR = 0.5
# Correlation of sensitivities from which effects share a line: sqrt(1 - 0.95^2) = 0.31 of their change distinguishes them.
# Two such columns have a collinearity index of 1 / sqrt(1 - 0.95) = 4.5; from 5 to 20 on parameters cannot be estimated
# together (Brun et al. 2001).
INDISTINGUISHABLE = 0.95
DECISIVE = float(np.log(10.0))  # log odds at which one of two effects is named

# Of the difference of two predictions, below which these readings do not show which is true: the expected log odds, SNR^2 /
# 2 = 2, are then below DECISIVE, Jeffreys' (1961) strong evidence.
SAME_READINGS_SNR = 2.0

# --- Held-out readings
# A gain counts above so many standard errors, or where it makes what was held out as many times likelier. For an answer that
# was fixed without it the second comes by chance once in as many at most (Markov's inequality), one of the two in 2.3 % at
# most (normal noise).
HELD_OUT_ERRORS, HELD_OUT_ODDS = 2.0, 100.0
# Of the sites and of the depths: a quarter is what Hastie, Tibshirani and Friedman (2009, section 7.2) test on.
HELD_OUT = 0.25
FEW_SITES = round(1 / HELD_OUT)  # below which a quarter of the sites is none

# --- What is weighed, and what is solved: limits of cost (judgement)
# Log weight behind the best, within which a set is judged with the errors of its change. Tempered it is exp(-0.4 x 12) =
# 1/120 of the best's probability, about where evidence against it is very strong (1/150, Kass and Raftery 1995).
REACH = 12.0
MOST_WITH_ERROR = 50  # such sets
BEAM = 30  # pairs that a third effect is tried next to
SETS_WITH_DISCREPANCY = 6  # best sets next to which a discrepancy is weighed
# Standard deviations of a change's own error, below which it moves no evidence: its log moves by 0.1^2 / 2 = 0.005, far
# below what is worth a mention (Kass and Raftery 1995).
NOTICED = 0.1
# Sets that are fitted with the finite elements, solutions of one set, and sites that are solved with an effect: at most
# 4 x 3 x 9 = 108 solutions of a site, some 20 s each. The longest verdict took 33 minutes (docs/results/verdicts.md).
MOST_SOLVED, MOST_SOLUTIONS, MOST_SITES = 4, 3, 9
MOST_FREE = 8  # sets that are fitted and need none
# Log weight behind the most probable set, within which another one is its competitor: below exp(-5) = 1/150 evidence against
# it is very strong (Kass and Raftery 1995).
COMPETITOR = 5.0
# Of what the real model changes over the linear one: below one standard deviation the linear pass is not made again, as
# the log evidence moves by SNR^2 / 2 = 0.5, not worth a mention (Kass and Raftery 1995).
CURVED_SNR = 1.0
STRONG_SNR = 10.0  # of a defect's change: below it what lies between places is less than noise
OBSERVABLE = 0.1  # of the largest change of a site, above which a site is worth solving
REACH_MM = 7.0  # a defect whose middle is farther is not observable: a ball of 1.3 mm changes Fz by 0.6 %
FEWEST = 0.5  # of the readings; where fewer can be followed the study does not describe what was pressed (judgement)
