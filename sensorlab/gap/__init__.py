"""Why a simulated record differs from the real one.

A simulator is a set of hypotheses. Every effect that it may lack joins it as one more
hypothesis, and Eq. (10) gives its probability. An effect is given by what it does:

    columns    something known, times an unknown size, is added to the record
    model      another shaping filter, or another variance, inside the model
    drive      the noise that drives the hypothesis's own states changes at a sample
    jumps      noise that is not Gaussian: a filter with several modes
    reading    the values themselves are altered: rounded, clipped, repeated
    factor     a parameter of the simulator is itself wrong

Evidence is integrated over all parameters, Eq. (11), by adaptive importance sampling.

Notation
    scene        a record and what was recorded beside it
    member       a hypothesis of the simulator with the effects inside its filter
    found        an effect with its column, its variant and its values
    signature    the columns of a found effect, with the prior of their size
    family       one effect on one column: signatures at many values of psi
    scan         gains of a family's thousands of signatures at one node
    psi          what a signature depends on besides its size: onset, frequency, tau
    variant      one of several forms of an effect: the square or the modulus of a rate
    low-pass     a digital one that all passes: edges before it are smooth behind it
    reading      what the values of a record show by themselves: a lattice, a limit
    stand-in     what stands for jumps, or a level, where all must be Gaussian
    account      what a record is explained by: members, signatures, readings, a fit
    cause        a set of effects with its probability; the empty one is none
    place        one of six ways to look: time, frequency, averaging time, lag,
                 amplitude, covariate
    gap          distances of a record from the simulator of an account, by place
    closure      how much smaller the gap is with the effects that were found
    remainder    what is left of it then; flexible: described by any colour and spread
    twins        records of a simulator that is known by them alone, its own
    joint        what one such record tells of all parameters together
    drift        the error integrated over a horizon, which a gap costs a user
    held out     the last third of a record, foretold by a fit of the rest
    theta, x     parameters; the same where the prior is N(0, I)
    w, C         weights; covariance of a record under a member
    z            normal scores of a record, N(0, 1) and white if all is well

The files read in the order of the argument; each takes only from those before it:
costs, effects, members, shapes, processes, values, steep, integrated, repeats,
interpolated, resampled, dropouts, catalogue, own, kernels, lowpass, draws, parts,
linear, filters, backward, evidence, changes, joint, screens, spectra, signatures,
onsets, scans, tuning, codes, clipping, unaveraged, averages, readings, standins,
scales, guesses, account, implied, directed, rival, wrong, inside, sought, weighing,
causes, refits, pairs, probes, places, distance, closure, drift, twins, flexible,
search, remainder, verdict, known, diagnosis, augmented, blackbox, sizes, words, report,
curves.
"""
