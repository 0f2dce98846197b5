"""Fields of a design: how they are declared with unit, symbol, origin and bounds, and checked."""
import dataclasses
import math


class VibratorError(ValueError):
    """A design that cannot be: the message names the source, the field, the value and the bound."""


def quantity(default, unit, symbol, text, origin, low=-math.inf, high=math.inf, above=None):
    """Declare one field of a design: `low` and `high` are allowed values, `above` is not."""
    return dataclasses.field(default=default, metadata={
        'unit': unit, 'symbol': symbol, 'text': text, 'origin': origin,
        'low': low, 'high': high, 'above': above})


def check_fields(design) -> None:
    """Check every field of a frozen dataclass of quantities, and store it as a float."""
    for field in dataclasses.fields(design):
        value = check_quantity(field, getattr(design, field.name))
        object.__setattr__(design, field.name, value)


def check_quantity(field, value):
    """Return the field's value as a float (or None where it may be), or raise VibratorError."""
    meta = field.metadata
    unit = '' if meta['unit'] == '1' else f' {meta["unit"]}'
    in_unit = f' in{unit}' if unit else ''
    label = f'{field.name} ({meta["symbol"]})'
    if value is None and field.default is None:
        return None
    if value is None or isinstance(value, bool):
        raise VibratorError(f'{label} = {value}: a number{in_unit} is expected')
    try:
        # Text too: YAML 1.1 takes 1.4e9 for text, its numbers want a dot and a signed exponent.
        value = float(value)
    except (TypeError, ValueError, OverflowError):
        raise VibratorError(f'{label} = {str(value)[:60]!r} is not a number'
                            f'{in_unit}') from None
    if not math.isfinite(value):
        raise VibratorError(f'{label} = {value} is not a finite number')
    if meta['above'] is not None and value <= meta['above']:
        raise VibratorError(f'{label} = {value:g}{unit} must be above {meta["above"]:g}{unit}')
    if not meta['low'] <= value <= meta['high']:
        raise VibratorError(f'{label} = {value:g}{unit} is outside '
                            f'[{meta["low"]:g}, {meta["high"]:g}]{unit}')
    return value
