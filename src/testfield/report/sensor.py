"""The sheet of a sensor: table, JSON, the TOML that scenes include, and the page with its curves."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from markupsafe import Markup

from testfield.characterise.characterise import CameraSheet, scene_tables
from testfield.characterise.figures import Figure
from testfield.characterise.sheet import ChannelSheet
from testfield.report.pages import page
from testfield.report.style import ACCENT, FAINT, WARM, figure, svg_of
from testfield.store.atomic import whole
from testfield.store.stamp import stamp
from testfield.store.text import write_text

TITLES = {
    "gain_dn_per_e": "system gain K",
    "gain_e_per_dn": "conversion 1 / K",
    "black_level_dn": "black level, without exposure",
    "dark_noise_dn": "temporal dark noise",
    "read_noise_e": "read noise, quantisation taken out",
    "saturation_e": "saturation capacity (largest variance)",
    "full_well_e": "full well, or the converter's end",
    "least_signal_e": "absolute sensitivity threshold",
    "dynamic_range": "dynamic range",
    "dynamic_range_db": "dynamic range",
    "snr_max": "largest signal to noise ratio",
    "snr_max_db": "largest signal to noise ratio",
    "responsivity_dn_per_photon": "responsivity",
    "responsivity_dn_per_light": "responsivity, light as the table has it",
    "quantum_efficiency": "quantum efficiency",
    "least_signal_photons": "absolute sensitivity threshold",
    "saturation_photons": "saturation capacity",
    "linearity_error_percent": "linearity error, mean of |deviations|",
    "linearity_error_min_percent": "linearity error, least",
    "linearity_error_max_percent": "linearity error, largest",
    "dark_current_mean_e_per_s": "dark current, from means",
    "dark_current_variance_e_per_s": "dark current, from variances",
    "dsnu_e": "DSNU",
    "dsnu_column_e": "DSNU of columns",
    "dsnu_row_e": "DSNU of rows",
    "dsnu_pixel_e": "DSNU of pixels",
    "dsnu_white_e": "DSNU of pixels, slow changes taken out",
    "prnu_percent": "PRNU, uneven light in it",
    "prnu_column_percent": "PRNU of columns",
    "prnu_row_percent": "PRNU of rows",
    "prnu_pixel_percent": "PRNU of pixels",
    "prnu_white_percent": "PRNU of pixels, uneven light taken out",
}
"""What each figure is, in the order in which they are shown."""


def shown(one: Figure) -> tuple[str, str]:
    """Value and standard uncertainty as text, with two digits of the uncertainty."""
    if not np.isfinite(one.value):
        return "–", ""
    if not (np.isfinite(one.u) and one.u > 0):
        return f"{one.value:.5g}", ""
    places = int(np.clip(1 - np.floor(np.log10(one.u)), 0, 9))
    return f"{one.value:.{places}f}", f"{one.u:.{places}f}"


def rows_of(figures: dict[str, Figure]) -> list[tuple[str, str, str, str]]:
    """(title, value, u, unit) of all figures, in their order."""
    return [(TITLES[name], *shown(figures[name]), figures[name].unit) for name in TITLES if name in figures]


def write_sensor(sheet: CameraSheet, folder: Path) -> dict[str, Any]:
    """`sensor.json`, `sensor.toml`, `sensor.html`; returns what the JSON file holds."""
    folder.mkdir(parents=True, exist_ok=True)
    tables = scene_tables(sheet)
    data = stamp() | {
        "source": sheet.series.source,
        "standard": "EMVA 1288 release 4.0, linear model",
        "bits": sheet.bits,
        "size_px": list(sheet.size_px),
        "bayer": sheet.series.bayer,
        "figures": {name: one.to_json() for name, one in sheet.figures.items()},
        "channels": {one.name: _channel(one) for one in sheet.channels},
        "notes": list(sheet.notes),
        "scene": tables,
    }
    with whole(folder / "sensor.json") as path:
        write_text(path, json.dumps(data, indent=1, allow_nan=False))
    with whole(folder / "sensor.toml") as path:
        write_text(path, _toml(sheet, tables))
    with whole(folder / "sensor.html") as path:
        write_text(path, _page(sheet, tables))
    return data


def _channel(one: ChannelSheet) -> dict[str, Any]:
    t = one.transfer
    return {
        "figures": {name: item.to_json() for name, item in one.figures.items()},
        "frames_of_stacks": {"lit": one.stack_frames[0], "dark": one.stack_frames[1]},
        "gain_scatter": t.gain.scatter,
        "saturated": t.saturated,
        "saturation_level": t.saturation,
        "lit": _columns(asdict(one.lit) | {"signal_dn": t.signal_dn, "fitted": t.fitted}),
        "dark": _columns(asdict(one.dark)),
    }


def _columns(arrays: dict[str, np.ndarray]) -> dict[str, list[Any]]:
    return {
        name: [None if isinstance(v, float) and not np.isfinite(v) else v for v in values.tolist()]
        for name, values in arrays.items()
    }


def _toml(sheet: CameraSheet, tables: dict[str, dict[str, Any]]) -> str:
    """The sensor for a scene: a file that a scene names in `include`."""
    f = sheet.figures
    said = [
        f"Sensor measured from {sheet.series.source} by testfield sensor (EMVA 1288 release 4.0, linear model).",
        'A scene takes it by include = ["sensor.toml"]; what the scene itself says goes first.',
        *(f"{title}: {value} {unit}, u = {u}" for title, value, u, unit in rows_of(f) if u),
        *sheet.notes,
    ]
    return "".join(f"# {line}\n" for line in said) + "\n" + tomli_w.dumps(tables)


def _page(sheet: CameraSheet, tables: dict[str, dict[str, Any]]) -> str:
    columns = {one.name: one.figures for one in sheet.channels}
    if len(columns) > 1:  # what a scene takes is the mean over the kinds of pixels
        columns = {"all": sheet.figures} | columns
    return page(
        "sensor.html",
        sheet=sheet,
        names=list(columns),
        rows=[
            (title, [shown(own[name]) if name in own else ("–", "") for own in columns.values()], unit)
            for name, title in TITLES.items()
            if (unit := next((own[name].unit for own in columns.values() if name in own), None)) is not None
        ],
        channels=[
            {
                "name": one.name,
                "frames": one.stack_frames,
                "transfer": photon_transfer(one),
                "linearity": linearity(one),
                "snr": signal_to_noise(one),
                "dark": dark_over_time(one),
                "histograms": histograms(one),
            }
            for one in sheet.channels
        ],
        toml=tomli_w.dumps(tables),
    )


def photon_transfer(one: ChannelSheet) -> Markup:
    """Temporal variance over mean above dark, with the line of the gain."""
    t = one.transfer
    with figure(6.1, 3.6) as (drawing, axes):
        fitted = t.fitted
        axes.errorbar(t.signal_dn, t.excess_dn2, t.u_excess_dn2, fmt="o", ms=2.8, color=FAINT, lw=0.6)
        axes.plot(t.signal_dn[fitted], t.excess_dn2[fitted], "o", ms=3.8, color=ACCENT, zorder=4)
        end = t.signal_dn[t.saturation]
        axes.plot([0, end], [0, t.gain.slope * end], color=WARM, lw=1.2)
        axes.axvline(end, color=FAINT, lw=0.8, ls="--")
        axes.set_xlabel("mean above dark, DN")
        axes.set_ylabel("temporal variance above dark, DN²")
        return _inline(drawing)


def linearity(one: ChannelSheet) -> Markup | None:
    """Deviation from the line of mean over light between 5 and 95 % of saturation."""
    line = one.transfer.linearity
    if line is None:
        return None
    with figure(6.1, 3.6, rows=2, sharex=True) as (drawing, (above, below)):
        t = one.transfer
        above.plot(one.lit.light, t.signal_dn, "o", ms=2.8, color=ACCENT)
        reach = np.array([0, one.lit.light[t.saturation]])
        above.plot(reach, line.offset_dn + line.slope * reach, color=WARM, lw=1)
        above.set_ylabel("above dark, DN")
        noise = 100 * one.lit.u_mean_dn / np.maximum(t.signal_dn, 1e-9)
        below.errorbar(one.lit.light, line.deviation_percent, noise, fmt="o", ms=2.8, color=ACCENT, lw=0.6)
        below.axhline(0, color=FAINT, lw=0.8)
        below.set_ylabel("deviation, %")
        below.set_xlabel("light, as the table has it")
        return _inline(drawing)


def signal_to_noise(one: ChannelSheet) -> Markup:
    """SNR over electrons, measured and by the linear model."""
    t, f = one.transfer, one.figures
    here = (t.signal_dn > 0) & (np.arange(len(one.lit)) <= t.saturation)
    electrons = t.signal_dn[here] / t.gain.slope
    with figure(6.1, 3.6) as (drawing, axes):
        axes.loglog(electrons, t.signal_dn[here] / np.sqrt(one.lit.var_dn2[here]), "o", ms=3, color=ACCENT)
        e = np.geomspace(max(electrons.min(), 1e-3), electrons.max(), 200)
        noise = f["dark_noise_dn"].value / t.gain.slope
        axes.loglog(e, e / np.sqrt(noise**2 + e), color=WARM, lw=1.1)
        prnu = f["prnu_white_percent"].value / 100
        fixed = noise**2 + e + f["dsnu_e"].value ** 2 + (prnu * e) ** 2
        axes.loglog(e, e / np.sqrt(fixed), color=FAINT, lw=1.1)
        axes.set_xlabel("electrons")
        axes.set_ylabel("signal to noise ratio")
        return _inline(drawing)


def dark_over_time(one: ChannelSheet) -> Markup | None:
    """Mean and variance of darks over the exposure time; None where no line was drawn through them."""
    if one.dark_mean is None or one.dark_var is None:
        return None
    with figure(6.1, 3.6, rows=2, sharex=True) as (drawing, both):
        for axes, y, u, line, what in (
            (both[0], one.dark.mean_dn, one.dark.u_mean_dn, one.dark_mean, "mean, DN"),
            (both[1], one.dark.var_dn2, one.dark.u_var_dn2, one.dark_var, "variance, DN²"),
        ):
            axes.errorbar(one.dark.time_ms, y, u, fmt="o", ms=2.8, color=ACCENT, lw=0.6)
            reach = np.array([0, float(one.dark.time_ms.max())])
            axes.plot(reach, line.offset + line.slope * reach / 1000, color=WARM, lw=1)
            axes.set_ylabel(what)
        both[1].set_xlabel("exposure time, ms")
        return _inline(drawing)


def histograms(one: ChannelSheet) -> Markup:
    """Pixels of the two mean images on a logarithmic scale, with normal distributions of the same spread."""
    with figure(6.1, 3.2, 2) as (drawing, both):
        for axes, image, what in (
            (both[0], one.dark_image_dn, "dark, DN from the mean"),
            (both[1], one.lit_image_dn, "lit, DN from the mean"),
        ):
            values = image.ravel() - image.mean()
            spread = max(float(values.std()), 1e-9)
            counts, edges, _ = axes.hist(values, bins=121, color=ACCENT, alpha=0.85)
            middle = (edges[1:] + edges[:-1]) / 2
            normal = (
                values.size * np.diff(edges) * np.exp(-0.5 * (middle / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
            )
            axes.plot(middle[normal > 0.3], normal[normal > 0.3], color=WARM, lw=1.1)
            axes.set_yscale("log")
            axes.set_ylim(0.5, 2 * max(float(counts.max()), 1.0))
            axes.set_xlabel(what)
        both[0].set_ylabel("pixels")
        return _inline(drawing)


def _inline(drawing: Any) -> Markup:
    svg = svg_of(drawing)
    return Markup(svg[svg.index(b"<svg") :].decode())
