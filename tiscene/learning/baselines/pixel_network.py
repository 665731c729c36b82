# SPDX-License-Identifier: Apache-2.0
"""PixelLearner: a small convolutional network trained on labeled pixels, the base of the baselines."""

from __future__ import annotations

import contextlib
import copy
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.errors import requires_extra
from tiscene.learning.answers import Answer
from tiscene.learning.phase import CourseFrame

with requires_extra("torch"):
    import torch
    from torch import nn

RECENT = 128  # frames that are kept for labels that arrive late


class PixelNetwork(nn.Module):  # type: ignore[misc]  # torch is not read
    """Category scores of each pixel from its surroundings of 31 x 31 px, computed at half the resolution.

    Args:
        categories: number of category ids, the background included.
        width: channels.
    """

    def __init__(self, categories: int, width: int = 24) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for channels, stride, dilation in ((3, 2, 1), (width, 1, 1), (width, 1, 2), (width, 1, 4)):
            layers.append(nn.Conv2d(channels, width, 3, stride, padding=dilation, dilation=dilation))
            layers += [nn.GroupNorm(4, width), nn.ReLU()]
        self.layers = nn.Sequential(*layers)
        self.head = nn.Conv2d(width, categories, 1)

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Return scores [n, categories, h, w] of pictures [n, 3, h, w]."""
        return _enlarged(self.head(self.layers(pictures)), pictures)

    def features(self, pictures: torch.Tensor) -> torch.Tensor:
        """Return features [n, width, h, w] of pictures [n, 3, h, w]. The head maps them to the scores."""
        return _enlarged(self.layers(pictures), pictures)


def _enlarged(values: torch.Tensor, pictures: torch.Tensor) -> torch.Tensor:
    """Return values at half the resolution at that of the pictures, interpolated."""
    height, width = pictures.shape[2:]
    return nn.functional.interpolate(values, scale_factor=2, mode="bilinear")[..., :height, :width]


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one thread: faster for pictures this small, and equal on machines with more cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@dataclass(frozen=True, eq=False)
class LabeledPicture:
    """A picture with the labels of some of its pixels.

    Attributes:
        rgb: uint8 [h, w, 3].
        labels: int64 [n, 3], rows (y, x, category id).
    """

    rgb: NDArray[np.uint8]
    labels: NDArray[np.int64]

    @property
    def nbytes(self) -> int:
        """Memory of both arrays, bytes."""
        return self.rgb.nbytes + self.labels.nbytes


class PixelLearner:
    """A network that takes one gradient step for each frame with labels.

    Subclasses change what is in a step (`examples`), what is added to the loss (`penalty`), and what happens around it.

    Args:
        categories: names by category id.
        seed: of the initial weights and of all draws.
        rate: learning rate.
    """

    def __init__(self, categories: Mapping[int, str], seed: int = 0, rate: float = 2e-3) -> None:
        self.seed, self.rate, self.count = seed, rate, max(categories) + 1
        self.rng = np.random.default_rng((0xBA5E, seed))
        self.recent: dict[int, NDArray[np.uint8]] = {}
        self.reset()

    def reset(self) -> None:
        """Set the network to its initial weights."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            self.network = PixelNetwork(self.count)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=self.rate)

    @one_thread()
    def predict(self, frame: CourseFrame) -> NDArray[np.int64]:
        """Return the category with the highest score at each pixel."""
        with torch.no_grad():
            scores = self.network(pictures([frame.rgb]))
        result: NDArray[np.int64] = scores[0].argmax(dim=0).numpy()
        return result

    def learn(self, frame: CourseFrame, answers: Sequence[Answer]) -> None:
        """Take a step on the labels that have arrived, if there are any."""
        keep_recent(self.recent, frame)
        arrived = self._arrived(answers)
        if arrived:
            self.step(self.examples(arrived))
            self.keep(arrived)

    def _arrived(self, answers: Sequence[Answer]) -> list[LabeledPicture]:
        rows: dict[int, list[tuple[int, int, int]]] = {}
        for each in answers_with_picture(answers, self.recent):
            rows.setdefault(each.frame, []).append((*each.pixel, each.category_id))
        return [LabeledPicture(self.recent[frame], np.array(labels)) for frame, labels in rows.items()]

    def examples(self, arrived: list[LabeledPicture]) -> list[LabeledPicture]:
        """Return what a step trains on."""
        return arrived

    def keep(self, arrived: list[LabeledPicture]) -> None:
        """Store what has been trained on."""

    @one_thread()
    def step(self, batch: list[LabeledPicture]) -> None:
        """Take a gradient step on labeled pictures."""
        inputs = pictures([each.rgb for each in batch])
        self.descend(self.loss(self.network(inputs), batch) + self.penalty(inputs))

    def descend(self, loss: torch.Tensor) -> None:
        """Take a step of the optimizer along the gradient of a loss alone."""
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()

    def loss(self, scores: torch.Tensor, batch: list[LabeledPicture]) -> torch.Tensor:
        """Return the mean cross-entropy of the labeled pixels."""
        rows = [np.full(len(each.labels), row) for row, each in enumerate(batch)]
        number = torch.from_numpy(np.concatenate(rows))
        labels = torch.from_numpy(np.concatenate([each.labels for each in batch]))
        return nn.functional.cross_entropy(scores[number, :, labels[:, 0], labels[:, 1]], labels[:, 2])

    def penalty(self, inputs: torch.Tensor) -> torch.Tensor | float:
        """Return what is added to the loss of a step."""
        return 0.0

    def stored_bytes(self) -> int:
        """Return the memory kept beside the network and its optimizer."""
        return 0

    def state_dict(self) -> dict[str, Any]:
        """Return the whole state, for checkpoints."""
        networks = {name: each.state_dict() for name, each in vars(self).items() if isinstance(each, nn.Module)}
        others = {name: each for name, each in vars(self).items() if name not in ("network", "optimizer", *networks)}
        return copy.deepcopy({"networks": networks, "optimizer": self.optimizer.state_dict(), "others": others})

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue where `state_dict` was taken."""
        state = copy.deepcopy(dict(state))
        vars(self).update(state["others"])
        self.network.load_state_dict(state["networks"]["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        for name, weights in state["networks"].items():
            if name != "network":
                network = PixelNetwork(self.count)
                network.load_state_dict(weights)
                setattr(self, name, network)


def keep_recent(recent: dict[int, NDArray[np.uint8]], frame: CourseFrame) -> None:
    """Add the picture of a frame to pictures by index, of which the last RECENT are kept."""
    recent[frame.index] = frame.rgb
    while len(recent) > RECENT:
        del recent[next(iter(recent))]


def answers_with_picture(answers: Sequence[Answer], recent: Mapping[int, Any]) -> list[Answer]:
    """Return the answers that are of recent frames. Warns of others, which cannot be learned."""
    found = [each for each in answers if each.frame in recent]
    if len(found) < len(answers):
        lost = next(each.frame for each in answers if each.frame not in recent)
        text = f"labels of frame {lost} are not learned: only the last {RECENT} pictures are kept; shorten delay="
        warnings.warn(text, stacklevel=3)
    return found


def pictures(rgb: Sequence[NDArray[np.uint8]]) -> torch.Tensor:
    """Return pictures as float32 [n, 3, h, w], -1..1."""
    stacked = torch.from_numpy(np.stack(rgb)).permute(0, 3, 1, 2)
    return stacked.float() / 127.5 - 1.0
