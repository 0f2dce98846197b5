"""Working off many designs: in chunks, here on all cores or on the workers of a dask cluster."""
from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from hpv_twin.model import VibratorError
from hpv_twin.model.batch import CYCLES, run_designs, threads_available
from hpv_twin.model.designs import Designs

ANSWER, WORKERS = 10, 30  # s to wait for a scheduler, for its first worker
CHUNK = 2000  # designs: some tenths of a second, which is how long Ctrl-C waits


class Farm:
    """
    Where designs are worked off; `with Farm(...) as farm`.

    On this machine with so many `threads` (default: all), or, given the `scheduler` address of a
    dask cluster, on its workers by joblib's dask backend, a chunk per task and one thread per task:
    start the workers with `--nthreads 1`, one per core. A worker that dies costs the time of what
    it was doing; dask gives that to another.
    """

    def __init__(self, threads: int | None = None, scheduler: str | None = None,
                 cycles: int = CYCLES, chunk: int = CHUNK):
        self.threads = threads_available() if threads is None else threads
        self.scheduler, self.cycles, self.chunk = scheduler, cycles, chunk
        self._client = None

    def __enter__(self) -> Farm:
        if self.scheduler:
            # Imported by who asks for it: they are another extra.
            import joblib  # noqa: F401
            from distributed import Client
            try:
                self._client = Client(self.scheduler, timeout=ANSWER)
            except (OSError, ValueError) as error:
                raise VibratorError(f'no dask scheduler answers at {self.scheduler} within '
                                    f'{ANSWER} s: {error}') from None
            try:
                self._client.wait_for_workers(1, timeout=WORKERS)
            except TimeoutError:
                self._client.close()
                raise VibratorError(f'the dask scheduler at {self.scheduler} has no workers; start '
                                    'some: dask worker ADDRESS --nthreads 1') from None
        return self

    def __exit__(self, *_):
        if self._client is not None:
            self._client.close()

    def run(self, designs: Designs) -> dict:
        """Return the figures of all these designs."""
        blocks = [block for _, block in self.work_off(len(designs), lambda a, b: designs[a:b])]
        return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}

    def work_off(self, total: int, make: Callable[[int, int], Designs],
                 start: int = 0) -> Iterator[tuple[int, dict]]:
        """
        Work off designs number `start` to `total`, which `make(a, b)` makes piece by piece.

        Yields, in order, how many are done and the figures of the latest chunk.
        """
        cuts = [(a, min(a + self.chunk, total)) for a in range(start, total, self.chunk)]
        if self._client is None:
            for a, b in cuts:
                yield b, run_designs(make(a, b), self.cycles, self.threads)
            return
        import joblib
        with joblib.parallel_config('dask', wait_for_workers_timeout=60):
            results = joblib.Parallel(return_as='generator')(
                joblib.delayed(run_designs)(make(a, b), self.cycles, 1) for a, b in cuts)
            for (_, b), figures in zip(cuts, results, strict=True):
                yield b, figures
