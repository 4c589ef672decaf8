"""The paper's figures and tables that the page of a study has too, by the page's ids."""

from __future__ import annotations

from mcstudy.analysis.publications.publication import Counterpart
from mcstudy_goodworth2018.paper.published import FMAX_HZ, METHODS

_RMS = " and ".join(f"about {x:g}°" for x in METHODS["noise-evoked sway RMS"][0])
_HZ = [f"{f:g}" for f in FMAX_HZ]

COUNTERPARTS = {
    "diagram": Counterpart("Fig. 1B"),
    "body": Counterpart("Table I"),
    "parameters": Counterpart("Table I"),
    "noise": Counterpart(
        "Fig. 2A",
        [f"The paper's RMS of the sway that noise evokes, θ1 and θ2: {_RMS}."],
        ("sway_1", "sway_1_cycle", "sway_2", "sway_2_cycle"),
    ),
    "spectra": Counterpart("Fig. 2B"),
    "sway": Counterpart("Fig. 2C"),
    "simulation_error": Counterpart(
        "Fig. 2D",
        [
            "The paper saw small, systematic errors at every solver and up to 10,000 Hz that disturbed fits at high "
            "frequency, where the FRF is small, and left them unexplained. Sampling explains these features: small in "
            "sway, repeated in every cycle, growing with frequency, independent of the solver. A transient does not: "
            "with the first cycle kept (dotted) errors are no longer small. Evidence: pipelines/fig2d.md."
        ],
    ),
    "controller_error": Counterpart(
        "Fig. 3A",
        ["The paper's points form a line because its solver stopped early; ours converges."],
        ("theory_cost", "theory_misses", "theory_relation"),
    ),
    "starts": Counterpart(
        "Fig. 3B",
        ["The paper's bars are SD over draws."],
        ("starts_noise_free", "starts_5", "starts_3", "cost_order", "misses"),
    ),
    "controller_error_with_noise": Counterpart(
        "Fig. 3C",
        rows=(
            "unstable_8",
            "unstable_8_most",
            *(f"relation_{r}_{o}" for r in ("noise", "8hz") for o in ("starts", "best")),
        ),
    ),
    "responses": Counterpart("Fig. 4", rows=("theory_mean_error", "theory_max_error"), letters="AABB"),
    "estimates": Counterpart(
        "Fig. 5",
        rows=(
            "spread_fmax",
            *(f"spread_amplitude_{f}" for f in _HZ),
            *(f"bias_12_{f}" for f in _HZ),
            "spread_8_larger",
            "spread_8hz_better",
            "spread_8hz_worse",
            "together_1",
            "together_2",
        ),
    ),
    "combined": Counterpart(
        "Fig. 6",
        rows=(
            *(f"bias_10_{f}" for f in _HZ),
            "bias_2_0.41",
            "bias_2_1.2",
            "spread_fmax_10",
            "spread_fmax_2",
        ),
    ),
    "bias": Counterpart(
        "Fig. 7A",
        rows=("bias_12_1.2", "bias_10_1.2", "bias_amplitude", "largest_bias", "bias_below_5_12_1.2", "bias_over_5"),
    ),
    "variability": Counterpart(
        "Fig. 7B",
        rows=("lowest_cv", "highest_cv", "combined_cv_lowest", "combined_cv_ratio", "low_cv", "cv_stiffness_damping"),
    ),
    "influence": Counterpart(
        "Fig. 7C",
        ["The ranges are the paper's; its pie charts are drawn as bars."],
        ("least_influential", "delays_low", "delays_high", "stiffness_low", "damping_high", "influence_cv"),
    ),
    "pairs": Counterpart(text=["That the data determine the sum but not its parts is the paper's third conclusion."]),
    "onestart": Counterpart(
        text=[
            "Goodworth & Peterka 2018, Discussion: with a single-link pendulum the fit “typically converges to what is "
            "likely to be a global minimum value with a single set of reasonable initial guesses”, with two segments "
            "it frequently does not."
        ]
    ),
}

HEADLINE = {"largest_error": "theory_max_error", "bias": "bias_12_{fmax}"}
"""Rows whose numbers the first screen of the page gives beside its own."""
