"""The physics of the hydropulse vibrator: design, equations, simulation and cycle figures."""
from .cycles import Cycle, CycleFinder, Cycles, find_cycles
from .ledger import EnergyLedger
from .simulation import ModelError, Simulation, Trace
from .slotted_spring import SlottedSpring
from .vibrator import Vibrator, VibratorError

__all__ = ['Cycle', 'CycleFinder', 'Cycles', 'EnergyLedger', 'ModelError', 'Simulation',
           'SlottedSpring', 'Trace', 'Vibrator', 'VibratorError', 'find_cycles']
