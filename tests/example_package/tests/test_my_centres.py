"""A detector of one's own against exact truth, and held to what it once could."""

import numpy as np
import pytest
from my_centres import find_dots


def errors_px(frames, truth) -> np.ndarray:
    """(n, 2) errors of all targets that were found, in all images."""
    found = []
    for frame, true_px, visible in zip(frames, truth.views.disc_px, truth.views.visible, strict=True):
        dots, marks = find_dots(frame.pixels_dn), true_px[visible == 1]
        away = np.linalg.norm(dots[:, None] - marks, axis=2)
        nearest = away.argmin(axis=0)
        found.append((dots[nearest] - marks)[away.min(axis=0) < 2])
    return np.concatenate(found)


@pytest.mark.field_scene("my_field.toml")
def test_it_is_as_good_as_it_was(field_scene, field_regression):
    field_regression.check({"rms_px": np.sqrt((errors_px(field_scene.frames, field_scene.truth) ** 2).mean())})


@pytest.mark.field_scene("my_field.toml")
def test_it_finds_most_targets(field_frames, field_truth):
    assert len(errors_px(field_frames, field_truth)) > 0.8 * (field_truth.views.visible == 1).sum()


@pytest.mark.field_scene("my_field.toml")
def test_over_draws_of_noise(field_scene, field_regression):
    def figures(draw: int) -> dict[str, float]:
        error = errors_px(field_scene.under(draw).frames, field_scene.truth)
        return {"rms_px": float(np.sqrt((error**2).mean())), "bias_x_px": float(error[:, 0].mean())}

    field_regression.check(
        figures, matters={"rms_px": 0.002, "bias_x_px": 0.002}, better={"bias_x_px": "same"}, budget=12
    )
