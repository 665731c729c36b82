# SPDX-License-Identifier: Apache-2.0
"""Train a small network online: each frame is predicted first, then learned from, and never stored.

    python examples/train_online.py --frames 1500 --plot training.png

The network names the class of each pixel: chair, ball, plant, or none of them. Objects bounce through the scene for as
long as the stream goes on. A second stream, with other paths, tests what was learned.
Needs `pip install 'tiscene[torch,examples]'`.
"""

import argparse

import numpy as np
import torch
from torch import nn

import tiscene as ts

CLASSES = ("none", "chair", "ball", "plant")
SETTINGS = {"width": 64, "height": 48, "quality": "fast", "buffers": ("rgb", "semantic"), "categories": CLASSES[1:]}
TEST_FRAMES = range(0, 400, 20)


def scenario(seed: int) -> ts.Scenario:
    """Return a scenario of three objects that bounce through the scene."""
    templates = ("Chair 01", "Ball 01", "Plant 01")
    starts = ((-0.8, 1.0, -2.6), (0.0, 1.2, -1.8), (0.8, 1.0, -2.4))
    objects = [
        ts.Object(
            template.split()[0],
            template,
            start,
            dynamic=ts.UniformMovementRandomBounce(speed=1.2, angular_speed=1.5, seed=10 * seed + number),
        )
        for number, (template, start) in enumerate(zip(templates, starts, strict=True))
    ]
    return ts.Scenario("object_view", objects, frustum=ts.Frustum(far=3.5))


class Network(nn.Module):
    """From pictures [n, 3, h, w] to the scores of classes [n, classes, h, w]: a U-Net with two levels."""

    def __init__(self) -> None:
        super().__init__()

        def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
            return nn.Sequential(nn.Conv2d(inputs, outputs, 3, stride, 1), nn.GroupNorm(4, outputs), nn.ReLU())

        self.fine = block(3, 16)
        self.coarse = nn.Sequential(block(16, 32, stride=2), block(32, 48, stride=2), block(48, 48), block(48, 48))
        self.grow = nn.Upsample(scale_factor=4, mode="bilinear")
        self.join = nn.Sequential(block(64, 24), nn.Conv2d(24, len(CLASSES), 1))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        fine = self.fine(pictures)
        return self.join(torch.cat([fine, self.grow(self.coarse(fine))], dim=1))


def tensors(frame: ts.Frame) -> tuple[torch.Tensor, torch.Tensor]:
    """Return picture [1, 3, h, w] and classes [1, h, w] of a frame."""
    picture = torch.from_numpy(frame.rgb).permute(2, 0, 1)[None] / 255 - 0.5
    return picture, torch.from_numpy(frame.semantic.astype(np.int64))[None]


def score(predicted: torch.Tensor, classes: torch.Tensor) -> float:
    """Return the intersection over union of predicted and true pixels, averaged over the objects in the picture."""
    present = [each for each in range(1, len(CLASSES)) if (classes == each).any()]
    ratios = [
        ((predicted == each) & (classes == each)).sum() / ((predicted == each) | (classes == each)).sum()
        for each in present
    ]
    return float(torch.stack(ratios).mean()) if ratios else float("nan")


def train(frames: int, test_every: int) -> tuple[list[float], dict[int, float]]:
    """Learn from a stream.

    Returns:
        The score of each frame before it was learned, and scores on the test frames by number of frames learned.
    """
    torch.manual_seed(0)
    torch.set_num_threads(1)  # the other core renders
    model = Network()
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    weights = torch.tensor([0.2, 1.0, 1.0, 1.0])  # most pixels are of no class
    with ts.Stream(scenario(seed=2), **SETTINGS) as stream:
        tests = [tensors(stream[index]) for index in TEST_FRAMES]
    before, tested = [], {}
    with ts.Stream(scenario(seed=1), frames=frames, prefetch=8, **SETTINGS) as stream:
        for frame in stream:
            picture, classes = tensors(frame)
            scores = model(picture)
            before.append(score(scores.argmax(1), classes))
            optimizer.zero_grad()
            nn.functional.cross_entropy(scores, classes, weights).backward()
            optimizer.step()
            if (frame.index + 1) % test_every == 0:
                tested[frame.index + 1] = test(model, tests)
                print(f"{frame.index + 1} frames: {tested[frame.index + 1]:.2f} on other paths")
    return before, tested


@torch.no_grad()
def test(model: nn.Module, tests: list[tuple[torch.Tensor, torch.Tensor]]) -> float:
    """Return the mean score of a model on pictures that it does not learn from."""
    return float(np.nanmean([score(model(picture).argmax(1), classes) for picture, classes in tests]))


def plot(path: str, before: list[float], tested: dict[int, float]) -> None:
    """Draw both scores over the number of frames."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    window = max(1, len(before) // 30)
    filled = np.nan_to_num(before, nan=float(np.nanmean(before)))
    figure, axes = pyplot.subplots(figsize=(7, 3.5), layout="constrained")
    axes.plot(np.arange(len(before)), before, ".", color="0.85", markersize=2)
    axes.plot(np.arange(window, len(before) + 1), np.convolve(filled, np.ones(window) / window, "valid"),
              label=f"next frame, before it is learned (mean of {window})")  # fmt: skip
    axes.plot(list(tested), list(tested.values()), "o-", label="frames of other paths")
    axes.set(xlabel="frames learned, each once", ylabel="intersection over union", ylim=(0, 1))
    axes.legend(loc="lower right", frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description="Train a small network online.")
    arguments.add_argument("--frames", type=int, default=1500)
    arguments.add_argument("--plot", help="picture to write")
    args = arguments.parse_args()
    before, tested = train(args.frames, test_every=max(1, args.frames // 15))
    if args.plot:
        plot(args.plot, before, tested)
