"""An experiment with simultaneous torques on ankle and hip: trials, and Monte Carlo estimates of the controllers.

The hip torque is the sequence of the ankle torque reversed in time, which has the same amplitude spectrum. Its sign
alternates between trials, so that the two are orthogonal over any pair of trials at every line, and no averaging over
frequency is needed (design derived; the usual alternative is to average cross-spectra over lines). With a hip
amplitude of zero it is the one-stimulus experiment of the same length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.errors import InputError
from mcstudy.spectra import periods
from mcstudy.spectra.bands import Bands
from mcstudy.spectra.estimate import check_period
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway
from mcstudy.stance.stimulus import Prts
from mcstudy_goodworth2018.alternatives.nonparametric import corrective_torque


@dataclass(frozen=True)
class Spectra:
    """Spectra of one realization of the experiment at the L lines of its bands, for the estimators of `nonparametric`.

    ``sway`` rad, ``torque`` N m (hip, ankle), ``stimuli`` N m (ankle, hip), each (trials, L, 2).
    """

    sway: np.ndarray
    torque: np.ndarray
    stimuli: np.ndarray


class TwoStimuli:
    """Trials with an ankle and a hip torque on the two-segment model; one object generates many realizations.

    Parameters
    ----------
    ankle: the ankle torque, with its amplitude.
    hip: amplitude of the hip torque, N m, in the same convention; 0 for none.
    bands: frequency points.
    noise: sensor noise, independent in every trial.
    trials: even number of trials.
    cycles, discard: recorded cycles of a trial, and number of them discarded at the start.
    body: inertia and gravity; the paper's by default.

    Raises `InputError` when trials are odd or the bands do not fit the stimulus.
    """

    def __init__(
        self,
        ankle: Prts,
        hip: float,
        bands: Bands,
        noise: SensorNoise | None = None,
        trials: int = 2,
        cycles: int = 6,
        discard: int = 1,
        body: Body | None = None,
    ) -> None:
        if trials < 2 or trials % 2:
            raise InputError(f"trials: expected an even number (the hip torque alternates in sign), got {trials}")
        if discard < 1 or cycles <= discard:
            raise InputError(f"cycles: expected at least one discarded cycle and one more, got {discard} of {cycles}")
        check_period(bands, ankle.period_s)
        self.bands, self.discard, self.period = bands, discard, ankle.samples
        self.model = two_segment(body)
        theta = self.model.truth
        forward = ankle.coefficients()[bands.lines]
        sign = np.where(np.arange(trials) % 2 == 0, 1.0, -1.0)
        hip_spectrum = hip / ankle.amplitude * forward.conj()
        self.stimuli = np.stack([np.tile(forward, (trials, 1)), sign[:, None] * hip_spectrum], axis=-1)
        columns = [frf(two_segment(body, kind), theta, bands.line_f) for kind in ("ankle_torque", "hip_torque")]
        self._evoked = np.einsum("lik,rlk->rli", np.stack(columns, axis=-1), self.stimuli)
        self._noise = NoiseSway(self.model, theta, noise or SensorNoise(), cycles * ankle.samples, ankle.rate_hz)

    def noise_free(self) -> Spectra:
        """The experiment without sensor noise."""
        return self._spectra(self._evoked)

    def realization(self, rng: np.random.Generator) -> Spectra:
        """One realization. The ramp of each record is removed, because inverse dynamics amplifies leakage by s^2."""
        records = (self._noise.sample(rng) for _ in self._evoked)
        noise = [periods.ramp_removed(x, self.period, self.discard)[self.bands.lines] for x in records]
        return self._spectra(self._evoked + np.stack(noise))

    def _spectra(self, sway: np.ndarray) -> Spectra:
        external = self.stimuli[..., ::-1]  # rows are (hip, ankle)
        return Spectra(sway, corrective_torque(self.model, sway, external, self.bands.line_f), self.stimuli)
