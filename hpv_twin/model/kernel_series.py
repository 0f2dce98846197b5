"""Compiled: what a Taylor series of the motion says: values, crossings, turns, reach."""
import math

from .compiling import inner
from .kernel_layout import NEVER

ORDER_FREE = 20  # no slot open: the coefficients cost next to nothing
ORDER_SLOT = 24
TOLERANCE = 1e-12  # last terms of a series, relative to the stroke and to the pressure's scale
# Below this the slot's flow is linear in the pressure: the root has no slope at zero.
LAMINAR = 1.0  # Pa above the drain
ROOT_LAMINAR = math.sqrt(LAMINAR)
# Rows of the workspace, coefficients in the parameter of the series: w (root law) or p - p_dp
# (else), y, v, net force, time; a row to spare; and a row of facts about the series.
LEVEL, POSITION, VELOCITY, FORCE, CLOCK, SPARE, FACTS = range(7)
# Facts: law of flow, order, p - p_dp at the start, where it ends and how long that takes, what
# happens there, where the pressure turns on the way (and its value), and the state at the end.
MODE, ORDER, ABOVE, END, DURATION, TURNS, LEAVES, DIRECTION = range(8)
TURN_TIME, TURN_P, END_P, END_Y, END_V, RISE, END_SLOPE = range(8, 15)
ORBIT = 48  # series kept from an opening on; what comes after uses the last place again and again
WORKSPACE = (ORBIT + 1, 7, ORDER_SLOT + 1)
LONGEST = 1.0  # s: a plunger at rest has a series without end
# How oil leaves: not at all at the vacuum limit, not while below the drain, by the linear or by
# the root law.
AT_VACUUM, DRY, LINEAR, TURBULENT = range(4)


@inner
def horner(c, order, at):
    """Value of the polynomial c[0] + c[1]*at + ...; its even and odd terms are summed abreast."""
    square = at * at
    first = order - (order & 1)
    even, odd = c[first], 0.0
    if order & 1:
        odd = c[order]
    for k in range(first - 2, -1, -2):
        even = even * square + c[k]
        odd = odd * square + c[k + 1]
    return even + at * odd


@inner
def crossing(c, order, level, side, end, guess):
    """
    First place in (0, end] at which side*(c - level) falls below zero; it is below at `end`.

    Newton's method from a guess, kept inside a bracket; the polynomial is taken to be above at 0
    even where rounding, or a start on the level itself, hides it.
    """
    low, high = 0.0, end
    at = guess
    for _ in range(100):
        # Value and slope, even and odd terms apart.
        square = at * at
        first = order - (order & 1)
        even, odd, even_slope, odd_slope = c[first], 0.0, 0.0, 0.0
        if order & 1:
            odd = c[order]
        for k in range(first - 2, -1, -2):
            even_slope = even_slope * square + even
            odd_slope = odd_slope * square + odd
            even = even * square + c[k]
            odd = odd * square + c[k + 1]
        value = side * (even + at * odd - level)
        steep = side * (2.0 * at * even_slope + odd + 2.0 * square * odd_slope)
        if value < 0.0:
            high = at
        else:
            low = at
        following = at - value / steep if steep != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
            if following == low or following == high:
                return at
        elif abs(following - at) <= 1e-8 * end:
            # The next step would be the square of this one.
            return following
        at = following
    return at


@inner
def turning(c, row, order, end):
    """Place in (0, end) at which row `row` turns; its slope has opposite signs at the ends."""
    for k in range(order):
        c[SPARE, k] = (k + 1.0) * c[row, k + 1]
    side = 1.0 if c[row, 1] > 0.0 else -1.0
    return crossing(c[SPARE], order - 1, 0.0, side, end, 0.5 * end)


@inner
def reach(c, order, stroke, unit):
    """Length over which the series holds to the tolerance, from its last two terms."""
    last = max(abs(c[LEVEL, order]) / unit, abs(c[POSITION, order]) / stroke)
    before = max(abs(c[LEVEL, order - 1]) / unit, abs(c[POSITION, order - 1]) / stroke)
    length = NEVER
    if last > 0.0:
        length = math.log(TOLERANCE / last) / order
    if before > 0.0:
        length = min(length, math.log(TOLERANCE / before) / (order - 1))
    return min(math.exp(length), LONGEST)


@inner
def direction_of(c, order):
    """Sign of the velocity just after the start of the series; 0 at rest for good."""
    for k in range(order + 1):
        if c[VELOCITY, k] != 0.0:
            return 1.0 if c[VELOCITY, k] > 0.0 else -1.0
    return 0.0


@inner
def monotone_end(c, order, direction, end):
    """Up to `end` or, before it, the first place at which the plunger turns round."""
    velocity = c[VELOCITY]
    if direction * horner(velocity, order, end) < 0.0:
        return crossing(velocity, order, 0.0, direction, end, end), True
    if direction * velocity[1] < 0.0:
        slope = order * velocity[order]
        for k in range(order - 1, 0, -1):
            slope = slope * end + k * velocity[k]
        if direction * slope > 0.0:
            # Slower, then faster: it may have turned twice.
            slowest = turning(c, VELOCITY, order, end)
            if direction * horner(velocity, order, slowest) < 0.0:
                return crossing(velocity, order, 0.0, direction, slowest, slowest), True
    return end, False


@inner
def level_end(c, order, low, high, end):
    """
    Up to `end` or, before it, the first place at which the LEVEL row leaves [low, high].

    Returns that place, and where the row turns on the way, or `end` if it does not.
    """
    level = c[LEVEL]
    slope = order * level[order]
    for k in range(order - 1, 0, -1):
        slope = slope * end + k * level[k]
    turn = end
    if level[1] * slope < 0.0:
        turn = turning(c, LEVEL, order, end)
        value = horner(level, order, turn)
        if value > high:
            return crossing(level, order, high, -1.0, turn, turn), end
        if value < low:
            return crossing(level, order, low, 1.0, turn, turn), end
    value = horner(level, order, end)
    if value > high:
        end = crossing(level, order, high, -1.0, end, end)
    elif value < low:
        end = crossing(level, order, low, 1.0, end, end)
    return end, turn


@inner
def pressure_at(c, drain, at):
    """Gauge pressure, Pa, on the series."""
    level = horner(c[LEVEL], int(c[FACTS, ORDER]), at)
    return (c[FACTS, ABOVE] * level * level if c[FACTS, MODE] == TURBULENT else level) + drain


@inner
def place_of(c, time):
    """Parameter of the series at `time` s after its start."""
    if c[FACTS, MODE] != TURBULENT or time <= 0.0:
        return max(time, 0.0)
    if time >= c[FACTS, DURATION]:
        return c[FACTS, END]
    # A cubic through both ends, with the slopes 1/w there, is a guess near enough.
    end, duration = c[FACTS, END], c[FACTS, DURATION]
    part = time / duration
    rest = 1.0 - part
    guess = (duration * part * rest * (rest - part * c[FACTS, END_SLOPE])
             + end * part * part * (3.0 - 2.0 * part))
    guess = min(max(guess, 0.0), end)
    return crossing(c[CLOCK], int(c[FACTS, ORDER]), time, -1.0, end, guess)


@inner
def slope_of(c, order, at):
    """First and second derivative of the LEVEL row of a series."""
    first = second = 0.0
    for k in range(order, 0, -1):
        second = second * at + first
        first = first * at + k * c[LEVEL, k]
    return first, second
