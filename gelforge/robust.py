"""What robust estimates of scatter share."""

# Of a normal deviate: standard deviation over median absolute deviation, 1 / Phi^-1(3/4) (Rousseeuw & Croux 1993,
# doi 10.1080/01621459.1993.10476408).
SIGMA_OF_MEDIAN = 1.4826
