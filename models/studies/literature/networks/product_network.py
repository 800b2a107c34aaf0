"""The product's own network, as a comparison trains it."""

from __future__ import annotations

import numpy as np

from stemwatch.models.studies.literature.networks.network import TrainedNetwork, TrainingInput


class ProductNarx:
    """The gated-increment NARX of ``stemwatch.models.narx``; see ``Network``."""

    name = "NARX (ours)"
    source = (
        "This product. Two of its eight networks start as the fitted canonical element, six from "
        "random weights; those that follow the training part best are kept, and the result is "
        "their mean."
    )
    limits = (
        "It starts from the canonical element, which has no actuator; a screening starts it from "
        "an element with dead time, lag and speed limit where a fit finds them.",
        "It knows what the training part showed: outside of its range the inputs are clamped.",
        "Its weights mean nothing one by one, and have no intervals.",
    )

    def equation(self) -> str:
        """The network in a line."""
        return "y(t) = y(t-1) + se sigmoid(wg.h + bg) (wv.h + c.x + bv), h = tanh(W x + b)"

    def learn(self, lesson: TrainingInput) -> TrainedNetwork:
        """Train on the samples before ``train_until``; the ensemble's mean free run."""
        from stemwatch.models.narx.architecture import StickSlipStart
        from stemwatch.models.narx.example import NarxExample
        from stemwatch.models.narx.training import train  # torch takes two seconds to import

        S, J = (lesson.element.parameters[name].value or 0.0 for name in ("S", "J"))
        start = StickSlipStart(S=S, J=J, zero=lesson.element.zero)
        example = NarxExample.of(lesson.recording, lesson.train_until, start)
        (fit,) = train([example])
        if fit.network is None or fit.simulated is None:
            return TrainedNetwork(outcome=fit.reason or "")
        weights = [array.ravel() for array in fit.network.weights.values()]
        return TrainedNetwork(weights=np.concatenate(weights), simulated=fit.simulated)


PRODUCT = ProductNarx()
