"""From starting values to the adjustment of exactly those observations that agree, discs and all."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Camera, Distances, Network, information_of
from testfield.calibrate.discs import Discs
from testfield.calibrate.doubts import geometric_doubts
from testfield.calibrate.lens_misfit import without_lens_misfit
from testfield.calibrate.misfit import (
    NO_MISFIT,
    Misfit,
    Names,
    excess_of,
    misfit_of,
    scatter_note,
    widened,
    widened_by_images,
)
from testfield.calibrate.settled import NOT_CONVERGED, REJECT_SIGMA, Settled, residual_sizes
from testfield.calibrate.sheets import (
    FEW,
    tested_bars,
    without_suspect,
)
from testfield.calibrate.start import Start
from testfield.calibrate.wrong_sheets import said_of, without_board, wrong_sheet
from testfield.camera.interior import Interior
from testfield.camera.project import directions
from testfield.camera.rays import meet_rays
from testfield.camera.several import by_camera
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError

LOST = 0.5
"""Part of an image's observations the loss of which leaves nothing to believe of it."""
ROUNDS = 12
MISFIT_ROUNDS = 3
EXPLAINED, EXPLAINED_PART = 4.0, 0.02
"""Variance factor that a misfit may leave, of what was called a wrong sheet or image, to be the explanation instead; or
as a part of the factor without it."""
SETTLED_PX = 1e-7


def settled(start: Start, rows: Observations, empirical: bool = False, misfit: Misfit | None = None) -> Settled:
    """Adjust a start: coarsely, then with everything, until nothing is rejected and the discs' offsets stand still.

    What residuals show that the model does not follow is adjusted too, or the `misfit` that is given; it is asked
    before a sheet or an image is called wrong. Bars come last: they are tested against what images and sheets made of
    them. `empirical` widens all covariances where observations scatter more than they claim, and where images
    contradict each other more than that; where the model fails they are widened anyway. Where the observations do not
    determine an unknown, the `TestfieldError` says which geometry is to blame.
    """
    discs = Discs(rows.moments_px2[start.rows], start.radius_mm) if rows.centre_of_disc else None
    try:
        coarse = _coarse(start.network)
        found = adjust(coarse, start.labels(coarse))
        network = replace(_refined(start.network, found.network), distances=Distances())
        plain = _settle(network, discs, start, rows)
        last = _followed(plain, network, discs, start, rows, misfit)
        if last.begin_again:
            return last
        last = replace(last, notes=[*last.misfit.notes, *last.notes])
        if len(start.network.distances):
            last = _with_bars(last, discs, start)
        if empirical or last.misfit.found:
            adjustment, factor = widened(last.adjustment, _unknowns(start))
            last = replace(last, adjustment=adjustment, widened=factor * last.misfit.variance)
        if last.widened > 1:
            last = replace(last, notes=[*last.notes, scatter_note(last.widened)])
        if empirical or last.misfit.found:
            adjustment, own, said = widened_by_images(last.adjustment, last.misfit, misfit, empirical)
            last = replace(last, adjustment=adjustment, misfit=own, notes=[*last.notes, *said])
    except TestfieldError as error:
        reasons = doubts_of_geometry(start.network, start)
        raise TestfieldError("; ".join([error.what, *reasons]), error.where, error.do) from error
    except np.linalg.LinAlgError as error:
        reasons = doubts_of_geometry(start.network, start)
        raise TestfieldError(
            "; ".join(["the adjustment does not come to rest", *reasons]),
            do="look at the sheets, the numbers, the images",
        ) from error
    return replace(last, plain=plain.adjustment if last.misfit.found else None)


def doubts_of_geometry(network: Network, start: Start) -> list[str]:
    """Sentences on weak geometry of a start's network at its present values."""
    cameras = tuple(camera.name for camera in start.imaging.cameras)
    return geometric_doubts(network, start.stations, start.boards, cameras)


def _unknowns(start: Start) -> Names:
    return start.labels


def _followed(
    last: Settled, network: Network, discs: "Discs | None", start: Start, rows: Observations, given: Misfit | None
) -> Settled:
    """Everything settled again with what the model does not follow, beginning with all observations: those that the
    model alone had turned down may be good. Asked again, without it, where other observations are turned down then."""
    names, rejected = _unknowns(start), -1
    plain = last
    for _ in range(MISFIT_ROUNDS):
        misfit = given or misfit_of(plain.adjustment, names, plain.adjustment.freedom)
        if not misfit.found or (plain.begin_again and not _explains(misfit, plain.adjustment)):
            return plain
        there = misfit.applied(plain.adjustment.network, names)
        there = replace(
            network,
            cameras=there.cameras,
            stations=there.stations,
            boards=there.boards,
            scale=there.scale,
            members=there.members,
            point_mm=there.point_mm,
            information=there.information,
            cov_px2=misfit.variance * network.cov_px2,
        )
        last = replace(_settle(there, discs, start, rows), misfit=misfit)
        if last.begin_again or given or len(last.rejected) in (rejected, len(plain.rejected)):
            break
        rejected = len(last.rejected)
        kept = last.adjustment.network
        again = replace(
            kept,
            cameras=without_lens_misfit(kept).cameras,
            information=network.information,
            cov_px2=kept.cov_px2 / misfit.variance,
        )
        plain = replace(last, adjustment=adjust(again, names(again)), notes=[], misfit=NO_MISFIT)
    return last


def _explains(misfit: Misfit, adjustment: Adjustment) -> bool:
    """Whether a misfit leaves little of what contradicts in an adjustment: a wrong sheet leaves most of it."""
    return misfit.variance < max(EXPLAINED, EXPLAINED_PART * excess_of(adjustment))


def _with_bars(answer: Settled, discs: "Discs | None", start: Start) -> Settled:
    """The answer with those control bars that agree with it."""
    bars = tested_bars(answer.adjustment, start.network.distances, start.bars)
    adjustment, doubts = _at_rest(bars.network, discs.take(answer.left) if discs else None, start)
    return replace(
        answer,
        adjustment=adjustment,
        certificates=(*answer.certificates, *bars.records),
        failures=(*answer.failures, *bars.failures),
        notes=[*answer.notes, *bars.notes, *doubts],
    )


def _settle(network: Network, discs: Discs | None, start: Start, rows: Observations) -> Settled:
    """Adjust until nothing is rejected any more and the discs' offsets stand still.

    Sheets are asked before pixels: what misses the rest more is called wrong. What is returned is always the adjustment
    of exactly the observations that remain.
    """
    labels = start.labels(network)
    names = _names(start, rows)
    rejected: list[dict] = []
    records: list[dict] = []
    notes: list[str] = []
    left = np.arange(len(network.point))
    most = max(4, FEW * np.bincount(network.point_board[network.point_board >= 0]).max(initial=0))
    for _ in range(ROUNDS):
        if discs:
            network = replace(network, offset_px=discs.offsets(network))
        adjustment = adjust(network, labels)
        network = adjustment.network
        size = residual_sizes(adjustment)
        # A bad point drags its neighbours along: only residuals near the worst go in one round.
        bad = (size > REJECT_SIGMA) & (size > 0.3 * size.max())
        doubtful = wrong_sheet(adjustment, labels, start, names)
        if doubtful:
            before = sum(len(r["marks"]) for r in records if r["board"] == doubtful.board)
            named = ", ".join(names[k] for k in doubtful.marks)
            name = f"{f'{named} of ' if named else ''}board '{start.boards[doubtful.board]}'"
            sigmas = float(np.sqrt(doubtful.value))
            records.append({"board": doubtful.board, "marks": doubtful.marks, "name": name, "sigmas": sigmas})
            many = before + len(doubtful.marks) > most
            if not doubtful.pose and (many or not doubtful.marks):
                return without_board(adjustment, doubtful, start, left, many)
            notes.append(f"{doubtful.said}: not used")
            network = without_suspect(network, doubtful)
            continue
        if not bad.any() and (
            discs is None or np.allclose(discs.offsets(network), network.offset_px, rtol=0, atol=SETTLED_PX)
        ):
            return Settled(adjustment, rejected, notes + _doubts(adjustment), left, said_of(records))
        lost = _lost_image(start, left, bad, network)
        if lost is not None:
            return Settled(adjustment, [], [], left, lost=lost)
        for k in np.flatnonzero(bad):
            owner = network.point_board[network.point[k]]
            board = start.boards[owner] if owner >= 0 else ""
            x, y = (float(v) for v in network.xy_px[k])
            station = start.stations[network.image[k]]
            why = f"residual beyond {REJECT_SIGMA:g} standard deviations"
            code = int(rows.code[start.rows[left[k]]])
            rejected.append(
                {"station": station, "board": board, "x_px": x, "y_px": y, "sigmas": float(size[k]), "why": why}
                | {"code": code, "point": int(rows.point[start.rows[left[k]]])}
            )
        network, discs, left = network.take(~bad), discs.take(~bad) if discs else None, left[~bad]
    adjustment = adjust(network, labels)
    notes += ["the rejection of outliers had not come to rest", *_doubts(adjustment)]
    return Settled(adjustment, rejected, notes, left, said_of(records))


def _lost_image(start: Start, left: np.ndarray, bad: np.ndarray, network: Network) -> int | None:
    """The image that loses most of its observations, if one does while the others keep theirs: it is misnumbered, or by
    another camera, and what of it would agree agrees by chance."""
    images = len(start.stations)
    if images < 3:
        return None
    whole = np.bincount(start.network.image, minlength=images)
    kept = np.bincount(network.image[~bad], minlength=images)
    # In a rig an image of which nothing is left keeps its place.
    share = np.where(whole > 0, 1 - kept / np.maximum(whole, 1), 0.0)
    worst = int(np.argmax(share))
    others = np.delete(np.arange(images), worst)
    rate = 1 - kept[others].sum() / max(whole[others].sum(), 1)
    return worst if share[worst] > LOST and rate < LOST / 2 else None


def _at_rest(network: Network, discs: Discs | None, start: Start) -> tuple[Adjustment, list[str]]:
    """The adjustment of a network from which nothing more is rejected."""
    labels = start.labels(network)
    for _ in range(ROUNDS):
        adjustment = adjust(network, labels)
        network = adjustment.network
        offset = discs.offsets(network) if discs else network.offset_px
        if np.allclose(offset, network.offset_px, rtol=0, atol=SETTLED_PX):
            break
        network = replace(network, offset_px=offset)
    return adjustment, _doubts(adjustment)


def _names(start: Start, rows: Observations) -> list[str]:
    """(n,) what a reader calls the points."""
    names = [""] * len(start.network.point_mm)
    for k, row in zip(start.network.point, start.rows, strict=True):
        code = int(rows.code[row])
        names[k] = f"code {code}" if code > 0 else f"mark {int(rows.point[row])}"
    return names


def _doubts(adjustment: Adjustment) -> list[str]:
    return [] if adjustment.converged else [f"{NOT_CONVERGED} after {adjustment.steps} steps"]


def _coarse_unknowns(interior: Interior) -> np.ndarray:
    """(n,) which parameters the focal length and the first radial coefficient are."""
    return np.isin(interior.names, ("fx", "fy", *interior.lens.radial_terms[:1]))


def _coarse(network: Network) -> Network:
    """The first adjustment: boards as on their sheets, a one-parameter lens, weights that forgive."""
    cameras = tuple(Camera.of(one.interior, one.unknown & _coarse_unknowns(one.interior)) for one in network.cameras)
    on_boards = network.point_board[network.point] >= 0
    coarse = network.take(on_boards)
    return replace(
        coarse,
        cameras=cameras,
        u_scale=0.0,
        information=information_of(np.zeros_like(network.known_mm)),
        cov_px2=np.broadcast_to(np.eye(2), coarse.cov_px2.shape).copy(),
        distances=Distances(),
    )


def _refined(network: Network, coarse: Network) -> Network:
    """The full network at the coarse one's camera, stations and boards, its loose points met anew."""
    points, poses = network.point_mm.copy(), coarse.camera_from_datum()
    for k in np.flatnonzero(network.point_board < 0):
        v = np.flatnonzero(network.point == k)
        rays = by_camera(directions, coarse.interiors, network.camera[v], network.xy_px[v])
        points[k] = meet_rays(rays, poses[network.image[v]], network.xy_px[v])
    cameras = tuple(replace(one, interior=found) for one, found in zip(network.cameras, coarse.interiors, strict=True))
    return replace(
        network,
        cameras=cameras,
        stations=coarse.stations,
        members=coarse.members,
        boards=coarse.boards,
        point_mm=points,
    )
