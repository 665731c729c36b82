# SPDX-License-Identifier: Apache-2.0
"""Extension of tiscene: questions of agents about single pixels, with a budget for each agent.

An agent asks for the labels of a pixel of the frame that it has received last. A learner that may only ask so often
switches its category and object views off, so that the answers are all that it is taught.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from dynamics import argument_checks
from tiscene.errors import ArgumentError
from tiscene.render.view import View
from tiscene.sailenv.agent_camera import AgentCamera
from tiscene.sailenv.category_numbers import CategoryNumbers
from tiscene.stream.stream import Stream

MAX_BUDGET = 2**31 - 1
_LABELS = ("instance", "semantic")


@dataclass(frozen=True)
class PixelAnswer:
    """The labels of a pixel.

    Attributes:
        frame: The index of the frame that was asked about.
        y: Row of the pixel, 0 at the top.
        x: Column, 0 at the left.
        category: The number in `category` views; 255 for none.
        name: The name of the category; "" for none.
        object: The id of the object, as `spawn_object` returns it, as a number; 0 for none.
        left: How many questions the agent has left; None for any number.
    """

    frame: int
    y: int
    x: int
    category: int
    name: str
    object: int
    left: int | None


class PixelQueries:
    """Answers the questions of all agents of an environment.

    Attributes:
        budget: How many questions each agent has; None for any number.
    """

    def __init__(self, budget: int | None) -> None:
        """Set the budget. Raises ArgumentError if it is invalid."""
        self.budget = None if budget is None else argument_checks.integer(budget, "query_budget", 0, MAX_BUDGET)
        self._last: tuple[Any, dict[str, NDArray[Any]]] = (None, {})  # what was rendered for the question before

    def forget(self) -> None:
        """Forget what was rendered, for a new scene."""
        self._last = (None, {})

    def ask(self, stream: Stream, numbers: CategoryNumbers, agent: AgentCamera, y: int, x: int) -> PixelAnswer:
        """Answer a question about a pixel of an agent's last frame, and count it.

        Args:
            stream: The stream of the scene.
            numbers: Numbers of its categories.
            agent: The agent.
            y: Row of the pixel, 0 at the top.
            x: Column, 0 at the left.

        Raises:
            ArgumentError: The pixel is outside of the image, the agent has not received a frame of this scene yet, or
                its budget is used up. The question does not count then.
        """
        y, x = argument_checks.integer(y, "y", 0, agent.height - 1), argument_checks.integer(x, "x", 0, agent.width - 1)
        camera = agent.last_camera
        if camera is None:
            raise ArgumentError("there is no frame to ask about: call get_frame() first")
        if self.budget is not None and agent.queries >= self.budget:
            raise ArgumentError(f"the budget of {self.budget} questions is used up")
        key = agent.last_frame, camera, agent.width, agent.height
        if self._last[0] != key:
            view = View(camera, camera, camera, agent.width, agent.height)
            self._last = key, dict(stream.render_view(agent.last_frame, view, _LABELS).buffers)
        labels = {name: int(buffer[y, x]) for name, buffer in self._last[1].items()}
        agent.queries += 1
        category = int(numbers.table(stream.categories)[labels["semantic"]])
        return PixelAnswer(
            agent.last_frame,
            y,
            x,
            category,
            stream.categories.get(labels["semantic"], "") if labels["semantic"] else "",
            labels["instance"],
            None if self.budget is None else self.budget - agent.queries,
        )
