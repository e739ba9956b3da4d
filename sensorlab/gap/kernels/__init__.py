"""Kernels of the gap: compiled recursions of sums of processes of one state or two.

    lanes        nodes side by side, threads, the steps that every recursion takes
    arithmetic   products and sums in an order of their own, exponentials abreast
    whitening    a filter without jumps at one node, there and back
    adjoint      C^-1 y at many nodes, and shocks at every sample
    told         what mixture filters tell of a sample
    outliers     the filter of outliers, unrolled
    levels       the filter of two levels, unrolled
    steps        the filter of a level that steps at random
    mixtures     the door to these, and the filter of whatever is left

Nodes, or pairs of a record and a node, lie side by side in the lanes of all arrays,
their last axis: the more, the less the loops around them cost. Inner loops take the
number of lanes from an array: one over 16 that are known to be 16 would be unrolled,
not vectorised, nor is `min` or `max` of two numbers; a step that calls another, and
a view of a row, count references, which takes as long as a step of few lanes.

h (n,) observes the states; of a covariance the lower half is kept. A state is ten
numbers, as `parts.Parts` has them: its factor a, and b of the other state of its pair;
variance q of its noise, and covariance c with that of the other; both of the state at
first; what is added to q and c, `rise` times, at each sample; and what is, as many
times as that is more than before. pair (n,) is the number of the other state, or its
own. (The bank of `sensorid` has steps of its own, which end
where gains have converged: tests/bench_gap.py has both.)

Kernels do the groups first ... last - 1 and are called through `in_threads`: a parallel
loop of Numba is compiled twice, which a first call would wait for, and its threads spin
while they wait. Arrays are copied by loops: the messages of a failed assignment take
longer to compile than most kernels.

Filters of few states, of outliers and of two levels, are unrolled: all numbers of a
group are rows of lanes in one array, and the loops over states, whose number is the
length of a tuple, have known lengths: LLVM unrolls these, if they are short, and makes
vectors of the loop around them. That must be long enough not to be unrolled itself.
What a kernel calls gets numbers, of states and of a level: it becomes part of the
kernel, where they are known, and is compiled once: for every number that stands there,
or is the length of a tuple, it would be again, for an np.int64 it is not. (What moves
a covariance of four states gets the tuple: otherwise LLVM gives it up.)
"""
