"""The U-Net without geometry."""

import pytest
import torch

from perception.models.image_unet import ImageUNet, ImageUNetConfig, mosaic


def test_images_lie_row_by_row_in_the_mosaic():
    images = torch.arange(4.0).reshape(1, 4, 1, 1, 1).expand(1, 4, 10, 30, 3)
    square = mosaic(images, 16)
    assert square.shape == (1, 16, 16, 3)
    assert square[0, ::8, ::8, 0].tolist() == [[0.0, 1.0], [2.0, 3.0]]
    assert (square[0, 8:, :8] == 2.0).all()


def test_images_are_averaged_and_places_left_over_are_black():
    images = torch.rand(2, 3, 16, 32, 3)
    square = mosaic(images, 16)
    blocks = images[1, 2].reshape(8, 2, 8, 4, 3).mean(dim=(1, 3))
    torch.testing.assert_close(square[1, 8:, :8], blocks)
    assert not square[:, 8:, 8:].any()


def test_it_needs_images_and_the_map_and_answers_with_logits():
    model = ImageUNet(ImageUNetConfig(channels=("road", "route", "lane")))
    assert model.needs == {"images", "route_map"}
    assert model.channels == ("road", "route", "lane")
    given = {
        "images": torch.randint(256, (2, 4, 112, 240, 3), dtype=torch.uint8),
        "route_map": torch.randint(256, (2, 192, 192), dtype=torch.uint8),
    }
    with torch.inference_mode():
        exact = model(given)
        with torch.autocast("cpu", torch.bfloat16):
            rough = model(given)
    assert exact.shape == (2, 3, 192, 192)
    assert exact.dtype == rough.dtype == torch.float32
    torch.testing.assert_close(rough, exact, atol=0.1, rtol=0.05)
    assert sum(parameter.numel() for parameter in model.parameters()) <= 2_300_000
    given["images"] = given["images"][:, :3]
    with pytest.raises(ValueError, match="made for 4 cameras, got 3"):
        model(given)


def test_a_rig_needs_cameras():
    with pytest.raises(ValueError, match="cameras must be an int of at least 1"):
        ImageUNetConfig(cameras=0)
