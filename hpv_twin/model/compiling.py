"""
How the compiled parts of the model are compiled, and kept on disk without going stale.

Numba's on-disk cache is keyed on the file of the compiled function alone, so a callee changed in
another file would leave stale machine code behind. But the key takes in what stands in a function's
closure too: there `entry` puts a digest of all files that hold compiled code.
"""
import hashlib
import types
import warnings
from pathlib import Path

import numba

# Compiled code stands in files of such names, and nowhere else.
SOURCES = (Path(__file__), *sorted(Path(__file__).parent.glob('kernel*.py')))

inner = numba.njit(error_model='numpy', _nrt=False)


def digest_of_sources() -> str:
    """Return what the source of all compiled code comes to."""
    digest = hashlib.sha256()
    for path in SOURCES:
        digest.update(path.read_bytes())
    return digest.hexdigest()


DIGEST = digest_of_sources()


def tied(function):
    """Return the same function with DIGEST in its closure, which it never reads."""
    code = function.__code__
    code = code.replace(co_freevars=(*code.co_freevars, 'digest_of_sources'))
    cells = (*(function.__closure__ or ()), types.CellType(DIGEST))
    made = types.FunctionType(code, function.__globals__, function.__name__,
                              function.__defaults__, cells)
    made.__doc__ = function.__doc__
    return made


def entry(function=None, **options):
    """
    Compile a function that Python calls, keeping the machine code on disk; `options` are numba's.

    Without a writable place for it the model is compiled in memory at each start, and says so.
    """
    if function is None:
        return lambda function: entry(function, **options)
    options = {'error_model': 'numpy', '_nrt': False, **options}
    try:
        return numba.njit(cache=True, **options)(tied(function))
    except RuntimeError:
        warnings.warn('no writable place for the compiled model: compiling it anew takes some '
                      'seconds at each start; NUMBA_CACHE_DIR can name one', stacklevel=2)
        return numba.njit(**options)(function)
