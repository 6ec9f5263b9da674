"""What people use today, through the same interface: OpenCV and scikit-image.

None of them states an uncertainty. What is claimed for them is the one that digitising an outline leaves (METHODS 6.2),
for all of them decide pixel by pixel what is inside.
"""

import warnings
from collections.abc import Callable

import cv2
import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.patches import patches
from testfield.registry import register

LEAST_PIXELS = 12


@register("centroids", "opencv_blob")
def opencv_blob(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """OpenCV's SimpleBlobDetector on each dot's window: contours at many thresholds, averaged.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    settings = cv2.SimpleBlobDetector.Params()
    settings.filterByColor, settings.blobColor = True, 255
    settings.filterByCircularity = settings.filterByConvexity = settings.filterByInertia = False
    settings.minArea, settings.maxArea = 6, 1e9
    settings.minThreshold, settings.maxThreshold, settings.thresholdStep = 40, 220, 10
    settings.minRepeatability = 2
    detector = cv2.SimpleBlobDetector.create(settings)

    def centre(grey: np.ndarray, _: np.ndarray) -> np.ndarray | None:
        points = detector.detect(grey)
        if not points:
            return None
        middle = (len(grey) - 1) / 2
        return min((np.array(point.pt) for point in points), key=lambda at: float(np.hypot(*(at - middle))))

    return _each(image_dn, sheet, xy_px, moments_px2, centre)


@register("centroids", "opencv_fit_ellipse")
def opencv_fit_ellipse(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Centres:
    """OpenCV's fitEllipse on the contour at the half threshold.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""

    def centre(_: np.ndarray, inside: np.ndarray) -> np.ndarray | None:
        contours, _hierarchy = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        largest = max(contours, key=len, default=None)
        return None if largest is None or len(largest) < 6 else np.array(cv2.fitEllipse(largest)[0])

    return _each(image_dn, sheet, xy_px, moments_px2, centre)


@register("centroids", "skimage_regionprops")
def skimage_regionprops(
    image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray
) -> Centres:
    """scikit-image's regionprops: the region above the half threshold, weighted with its intensity.

    Measures dots from rough centres (n, 2) and moments (n, 2, 2) in an image (h, w) of bright marks."""
    from skimage.measure import regionprops

    def centre(grey: np.ndarray, inside: np.ndarray) -> np.ndarray | None:
        regions = regionprops(inside.astype(int), grey)
        return np.array(regions[0].centroid_weighted[::-1]) if regions else None

    return _each(image_dn, sheet, xy_px, moments_px2, centre)


def _each(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    xy_px: np.ndarray,
    moments_px2: np.ndarray,
    centre: Callable[[np.ndarray, np.ndarray], np.ndarray | None],
) -> Centres:
    """Window by window: `centre` gets it in 8 bits, from background to dot, and what exceeds the half threshold."""
    found = Centres.empty(len(xy_px))
    for p in patches(image_dn, sheet, xy_px, moments_px2):
        contrast = np.maximum(p.contrast, 1e-9)[:, None]
        level = (p.values - p.black[:, None]) / contrast
        # What may be a ring is background, so that no opponent stumbles over it.
        level = np.where(p.use, level, 0)
        grey = (25 + 205 * level).clip(0, 255).astype(np.uint8).reshape(-1, p.side, p.side)
        inside = (level > 0.5).astype(np.uint8).reshape(-1, p.side, p.side)
        xy = np.full((len(grey), 2), np.nan)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for k in np.flatnonzero((p.contrast_over_noise > 4) & (inside.sum(axis=(1, 2)) >= LEAST_PIXELS)):
                at = centre(grey[k], inside[k])
                if at is not None:
                    xy[k] = at
        first = np.column_stack([p.x[:, 0], p.y[:, 0]])
        moments = moments_px2[p.rows]
        radius = 2 * np.maximum(np.linalg.det(moments), 1e-6) ** 0.25
        covariance = (0.1838**2 / radius)[:, None, None] * np.eye(2)
        found.put(p.rows, p.centres(xy + first, covariance, moments, np.isfinite(xy).all(axis=1)))
    return found
