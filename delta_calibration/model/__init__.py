"""Laws in symbols, and the compiled functions that are generated from them.

A law (a mechanism's closure, an effect's shift) is written once, for one sample, with the
functions of `symbols`. `Law` differentiates it and prints it as a list of instructions (those of
the package: `generated`); `lowering` makes machine code of these. `kernels` holds the loops over
samples, which are compiled once and call any law by its address.
"""
