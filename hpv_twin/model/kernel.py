"""
Everything compiled that makes one machine run, by one name: scalar code for numba, in parts.

`kernel_layout` says what stands where in the arrays, `kernel_machine` holds the machine and its
equations, `kernel_switches` the way from stage to stage, `kernel_ledger` the energies. Two
integrators stand on these: `kernel_euler`, and the default one, `kernel_exact`, with its closed
forms in `kernel_standing` and its series in `kernel_expand` and `kernel_series`.
"""
from .kernel_euler import *
from .kernel_exact import *
from .kernel_expand import *
from .kernel_layout import *
from .kernel_ledger import *
from .kernel_machine import *
from .kernel_series import *
from .kernel_standing import *
from .kernel_switches import *
