"""Why a simulated record differs from the real one.

A simulator is a set of hypotheses. Every effect that it may lack joins it as one more
hypothesis, in one of four ways:

  signature   something known times an unknown size is added to the record;
  process     another shaping filter, or another variance, inside the model;
  jumps       noises that are not Gaussian: a filter with several modes;
  reading     the values themselves are altered: rounded, clipped, repeated.

Evidence is integrated over all parameters, Eq. (11), by adaptive importance sampling.
"""
