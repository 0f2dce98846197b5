"""Parameters of a node, declared from a table and checked against it."""
from __future__ import annotations

import difflib
import math
from collections.abc import Mapping

from rclpy.parameter import Parameter as RosParameter

from .interface import Parameter
from .params_files import ParameterError

# Declared by rclpy itself.
FOREIGN_PARAMETERS = ('use_sim_time', 'start_type_description_service')


def declare(node, table: Mapping[str, Parameter], warn,
            origins: Mapping[str, str]) -> dict:
    """
    Declare a node's parameters with their bounds; return the values, None where there is none.

    The node was made with `automatically_declare_parameters_from_overrides`. `warn(text)` is told
    of unknown names. Raises ParameterError for values given from outside that cannot be, with the
    file that they come from where `origins` knows one.
    """
    given = {name: parameter.value
             for name, parameter in node.get_parameters_by_prefix('').items()}
    settings = {}
    for name in given:
        if name in FOREIGN_PARAMETERS or name.startswith('qos_overrides.'):
            continue
        if name not in table:
            near = difflib.get_close_matches(name, table, n=1)
            hint = f'; did you mean "{near[0]}"?' if near else ''
            warn(f'unknown parameter "{name}" is ignored{hint}')
        node.undeclare_parameter(name)
    for name, parameter in table.items():
        value = given.get(name, parameter.default)
        if value is not None:
            value = checked_from(origins.get(name), parameter, value)
            node.declare_parameter(name, value, parameter.descriptor(), ignore_override=True)
        settings[name] = value
    return settings


def as_declared(table: Mapping[str, Parameter]):
    """Return the callback that takes an integer given for a double as a double."""
    def convert(parameters):
        return [RosParameter(p.name, RosParameter.Type.DOUBLE, float(p.value))
                if p.type_ == RosParameter.Type.INTEGER and p.name in table
                and table[p.name].kind is float else p for p in parameters]
    return convert


def checked_from(origin, parameter, value):
    """`checked`, naming the file that the value comes from."""
    try:
        return checked(parameter, value)
    except ParameterError as error:
        raise ParameterError(f'{origin}: {error}' if origin else str(error)) from None


def checked(parameter, value):
    """Return a value of the declared type, or raise ParameterError naming type and bound."""
    if parameter.kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, parameter.kind):
        kind = {float: 'a number', bool: 'true or false', str: 'text'}[parameter.kind]
        raise ParameterError(f'parameter {parameter.name} = {value!r}: {kind} is expected '
                             f'({parameter.text})')
    if parameter.low is not None and not (
            math.isfinite(value) and parameter.low <= value <= parameter.high):
        raise ParameterError(f'parameter {parameter.name} = {value:g} is outside '
                             f'[{parameter.low:g}, {parameter.high:g}] ({parameter.text})')
    return value
