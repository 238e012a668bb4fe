"""The speed figures, as ratios to what one would write otherwise, measured side by side: ``python -m benchmarks``."""

import os

# one-core figures are of one core: set before numpy and JAX are loaded, and inherited by what is started
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
