"""A managed (lifecycle) node whose transitions end in a log line and never in the end of the process."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from moire_sensor.errors import SettingsError
from moire_sensor.ros.executable import USER_ERRORS

START_PERIOD_S = 0.05
# For what must go on while simulated time stands still.
STEADY_CLOCK = Clock(clock_type=ClockType.STEADY_TIME)
SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)
Step = Callable[[], None]
Entities = Callable[[LifecycleState], TransitionCallbackReturn]


class ManagedNode(LifecycleNode):  # type: ignore[misc]
    """A lifecycle node made of four steps: ``set_up``, ``begin``, ``pause`` and ``release``.

    rclpy leaves two things to its users: an exception in a transition vanishes without a word, and a request for a
    transition that the present state does not have ends the process. Here an error of the user fails the transition
    with its text in the log, any other exception with its traceback, and a request out of place is refused.

    Attributes
    ----------
    failure : the last error that failed a transition, or None.
    stop_asked : set by the executable; a step that waits looks at it and gives up.
    """

    def __init__(self, name: str, namespace: str) -> None:
        super().__init__(name, namespace=namespace)
        self.failure: Exception | None = None
        self.stop_asked: Callable[[], bool] = bool
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._answer_change_state

    def set_up(self) -> None:
        """Make publishers (unconfigured to inactive)."""

    def begin(self) -> None:
        """Make subscriptions (inactive to active); what publishes is enabled already."""

    def pause(self) -> None:
        """End subscriptions and finish what is under way (active to inactive); publishers are disabled afterwards."""

    def release(self) -> None:
        """Undo ``set_up``; must also work after half of it."""

    def is_ready(self) -> bool:
        """Tell whether ``begin`` can go without waiting."""
        return True

    def start_by_itself(self) -> None:
        """Configure at once, activate when ready; an error of the user ends the executable.

        A transition that someone else asks for meanwhile ends this.
        """
        self._start_from = "unconfigured"
        self._start = self.create_timer(START_PERIOD_S, self._start_step, clock=STEADY_CLOCK)

    @property
    def state_label(self) -> str:
        """Name of the present state, for example ``"active"``."""
        return str(self._state_machine.current_state[1])

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run ``set_up``; a failure leaves the node unconfigured, with nothing half made."""
        outcome = self._run("configure", self.set_up)
        if outcome != SUCCESS:
            self.release()
        return outcome

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Enable the publishers, then run ``begin``; a failure leaves the node inactive."""
        super().on_activate(state)
        outcome = self._run("activate", self.begin)
        if outcome != SUCCESS:
            self.pause()
            super().on_deactivate(state)
        return outcome

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run ``pause``, then disable the publishers: from here on nothing is published."""
        outcome = self._run("deactivate", self.pause)
        super().on_deactivate(state)
        return outcome

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run ``release``."""
        return self._run("cleanup", self.release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End from any state; the process stays, finalized, until it is asked to go."""
        return self._end("shutdown", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After an error that nobody foresaw: give everything back, so that the node can be configured again."""
        return self._end("error processing", state)

    def _start_step(self) -> None:
        if self.state_label != self._start_from:
            # Someone else asked for a transition meanwhile, and from then on decides.
            self._start.cancel()
            return
        if self._start_from == "unconfigured":
            self._start_from = "inactive"
            done = self.trigger_configure()
        elif self.is_ready():
            self._start.cancel()
            done = self.trigger_activate()
        else:
            return
        if done != SUCCESS:
            raise self.failure or SettingsError("the node cannot start; see the log")

    def _end(self, name: str, state: LifecycleState) -> TransitionCallbackReturn:
        def steps() -> None:
            self.pause()
            super(ManagedNode, self).on_deactivate(state)
            self.release()

        return self._run(name, steps)

    def _run(self, name: str, step: Step) -> TransitionCallbackReturn:
        try:
            step()
        except USER_ERRORS as error:
            self.failure = error
            self.get_logger().error(f"{name} failed: {error}")
            return FAILURE
        except Exception as error:
            self.failure = error
            self.get_logger().error(f"{name} failed: {traceback.format_exc()}")
            return ERROR
        self.get_logger().debug(f"{name}: done")
        return SUCCESS

    def _answer_change_state(self, request: Any, response: Any) -> Any:
        try:
            return self._change_state(request, response)
        except rclpy_implementation.RCLError:
            allowed = ", ".join(sorted({one[1] for one in self._state_machine.available_transitions}))
            asked = request.transition.label or request.transition.id
            self.get_logger().warning(
                f"transition {asked} is refused: the node is {self.state_label}; allowed are {allowed or 'none'}"
            )
            response.success = False
            return response
