"""The instrument panel: which views there are and where they stand.

Left, the machine: its cutaway at the time cursor, phase portrait and spectrum of that second, and
the events. Middle, its quantities: single cycles around the cursor over the phases of the
cyclogram, then the whole run, one strip per quantity. Right, the cards: recording and design.
"""
from __future__ import annotations

import rerun.blueprint as rrb

from hpv_twin.viewer import palette, scene
from hpv_twin.viewer.plots import WHOLE, Window, axis, cycle_view, strip, ticked_axis
from hpv_twin.viewer.portrait import (
    HEIGHT,
    WIDTH,
    has_portrait,
    has_spectrum,
    portrait_entity,
    spectrum_entity,
)
from hpv_twin.viewer.scene import Curve, Panel

PLAYBACK_SPEED = 0.02  # one cycle of 55 Hz lasts about a second
BACKGROUND = (20, 22, 26)


def build_blueprint(panels: list[Panel], has_design: bool = False,
                    window: Window = WHOLE) -> rrb.Blueprint:
    """Return the layout of all panels; each has a tab if there are several."""
    plots = [_machine(panel, window) for panel in panels]
    cards = [rrb.TextDocumentView(name='Recording', contents=[scene.CARD])]
    if has_design:
        cards.append(rrb.TextDocumentView(name='Design', contents=[scene.DESIGN]))
    return rrb.Blueprint(
        rrb.Horizontal(plots[0] if len(plots) == 1 else rrb.Tabs(*plots),
                       rrb.Vertical(*cards, row_shares=[10, 12][:len(cards)]),
                       column_shares=[10, 2.6]),
        rrb.TimePanel(timeline=scene.TIME, state='collapsed', **_playing(window)),
        collapse_panels=True, auto_views=False)


def _playing(window: Window) -> dict:
    """Return how the time cursor moves."""
    if window.is_live:
        return {'play_state': 'following', 'playback_speed': 1.0}
    return {'play_state': 'playing', 'playback_speed': PLAYBACK_SPEED, 'loop_mode': 'all'}


def _machine(panel: Panel, window: Window) -> rrb.Horizontal:
    """Return everything of one machine."""
    views, shares = _over_time(panel, window)
    return rrb.Horizontal(
        _pictures(panel), rrb.Vertical(*views, row_shares=shares, name='over time'),
        column_shares=[1.0, 1.0] if panel.cutaway else [0.6, 1.0], name=panel.name)


def _pictures(panel: Panel) -> rrb.Vertical:
    """Return the cutaway, phase portrait and spectrum as far as there are any, and the events."""
    views, shares, below = [], [], []
    if panel.cutaway:
        views, shares = [_cutaway(panel)], [4.2]
    if has_portrait(panel.machine):
        below.append(rrb.Spatial2DView(
            origin=portrait_entity(panel.machine), background=BACKGROUND,
            name='Velocity [m/s] over position [mm]',
            visual_bounds=rrb.VisualBounds2D(x_range=(-0.2, WIDTH + 0.05),
                                             y_range=(-HEIGHT - 0.1, 0.2))))
    if has_spectrum(panel.machine):
        below.append(rrb.BarChartView(
            origin=spectrum_entity(panel.machine), name='Plunger [mm] over frequency [Hz]',
            plot_legend=rrb.PlotLegend(visible=False)))
    if below:
        views.append(rrb.Horizontal(*below))
        shares.append(3.2)
    events = rrb.TextLogView(name='Events', contents=[scene.EVENTS], columns=rrb.TextLogColumns(
        text_log_columns=['LogLevel', 'Body']))
    return rrb.Vertical(*views, events, row_shares=[*shares, 2.0], name='machine')


def _cutaway(panel: Panel) -> rrb.Spatial3DView:
    """Return the view of the machine, seen from where all of it is in sight."""
    cutaway = panel.cutaway
    centre, distance = cutaway.drawing.eye()
    return rrb.Spatial3DView(
        origin=cutaway.root, name=cutaway.title(), background=BACKGROUND, line_grid=False,
        eye_controls=rrb.EyeControls3D(kind='Orbital', position=(centre, 0.0, distance),
                                       look_target=(centre, 0.0, 0.0), eye_up=(0.0, 1.0, 0.0)))


def _over_time(panel: Panel, window: Window) -> tuple[list, list[float]]:
    """Return the plots over time and their heights."""
    views = [('pressure, gauge [MPa]', panel.pressures)] if panel.pressures else []
    for unit in dict.fromkeys(curve.quantity.unit for curve in panel.joints):
        views.append((f'position [{unit}]', [c for c in panel.joints if c.quantity.unit == unit]))
    plots = [cycle_view(f'Cycles, {name}', curves,
                        panel.marks if curves is panel.pressures else [], window)
             for name, curves in views]
    heights = [2.4] * len(plots)
    if panel.phases:
        plots.append(_phases(panel, window))
        heights.append(1.0)
    title = f'Last {window.long:g} s' if window.is_live else 'Whole run'
    plots.append(strip(f'{title}, {views[0][0]}', panel.overview, axis(panel.overview), window))
    heights.append(1.5)
    rows = _rows(panel, window)
    if panel.estimates:  # no room for both: behind each other
        plots.append(rrb.Tabs(rrb.Vertical(*rows, name='Cycles and setpoints'),
                              rrb.Vertical(*_strips(panel.estimates, window), name='Estimates')))
        heights.append(1.1 * len(rows))
    else:
        plots += rows
        heights += [1.1] * len(rows)
    return plots, heights


def _rows(panel: Panel, window: Window) -> list:
    """Return the strips of cycle figures, then those of setpoints."""
    figures = [c for c in panel.numbers if c.quantity.label in palette.CYCLE_FIGURES]
    return _strips(figures, window) + _strips(
        [c for c in panel.numbers if c not in figures], window)


def _strips(curves: list[Curve], window: Window) -> list:
    """Return one strip for each curve, two in a row."""
    strips = [strip(_capital(curve.quantity.title), [curve], ticked_axis(curve), window)
              for curve in curves]
    pairs = [strips[at:at + 2] for at in range(0, len(strips), 2)]
    return [rrb.Horizontal(*pair) if len(pair) > 1 else pair[0] for pair in pairs]


def _phases(panel: Panel, window: Window) -> rrb.StateTimelineView:
    """Return the band of the cyclogram, over the same time as the cycles above it."""
    start, end = window.around_cursor()
    return rrb.StateTimelineView(
        origin=scene.phases_entity(panel.machine), name='Phases of the cyclogram',
        time_view=rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end)))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
