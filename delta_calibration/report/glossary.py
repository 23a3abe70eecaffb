"""Glossary of the words of all outputs; `docs/glossary.md` has the same text."""

from __future__ import annotations

from delta_calibration.report.document import Section, Table

GLOSSARY = "glossary"  # name of its section and table

TERMS: tuple[tuple[str, str], ...] = (
    (
        "before, calibrated, extended",
        (
            "Three models of the machine. Before: the nominal robot, or the active calibration, "
            "in its best-fit frame. Calibrated: with identified geometry. Extended: with the "
            "causes that were found as well. The tracker's frame and the reflector's offset are "
            "fitted in all three, because they are not errors of the machine. A model is never "
            "extended by something that predicts held-out poses worse."
        ),
    ),
    (
        "pose, place, reading, stop",
        (
            "A reading is one measurement of the tracker. A pose is the mean of the readings "
            "during one period at rest, with the joint command there. Poses with the same command "
            "(within 0.2 mrad of a Delta's joint) are at the same place. A stop is a pose "
            "requested by a plan. The ends of its paths are periods at rest too, so a session can "
            "have more poses than its plan has stops."
        ),
    ),
    (
        "noise of a pose",
        (
            "Root mean square 3-D error of a pose due to the tracker and the repeatability of the "
            "joints. It comes from repeated poses, or from the robot file if there are too few. A "
            "model whose error is about as large has nothing left to explain. If a strong cause "
            "also changes the repeats, a fit overestimates the noise; a diagnosis determines it "
            "again without the causes it found. Also called noise floor."
        ),
    ),
    (
        "in sample",
        (
            "Root mean square 3-D distance between measured and predicted points at the poses "
            "that the fit was made from. It says little about accuracy, because a fit adapts to "
            "its own data."
        ),
    ),
    (
        "held out",
        (
            "Predicted by a fit that has not seen the pose. There are two such figures: the error "
            "left of a fit and the held-out error of a diagnosis."
        ),
    ),
    (
        "error left",
        (
            "Figure of a fit and of a calibration file: root mean square 3-D distance between "
            "measured and predicted points over all accepted poses at rest, with equal weights. "
            "The places are divided at random into five parts, and each part is predicted by a "
            "fit to the other four. It is the error to expect between the measured places."
        ),
    ),
    (
        "held-out error",
        (
            "Figure of a diagnosis, its verdict and its report: the same distance over the same "
            "poses, but whole sectors of the workspace are held out, five by the bearing about z. "
            "(For a machine that works in an upright plane they are sectors about the middle of "
            "that plane; for places on a line, sections of it.) It is larger than the error left, "
            "because the model has to predict a region it has not seen. For a single cause it is "
            "given with and without that cause, with all others in the model. It is computed from "
            "readings in motion if the cause only shows in motion, and by sectors of the motions "
            "if one sector of the poses holds nearly all of these. For a smooth map, cells are "
            "held out instead of sectors."
        ),
    ),
    (
        "error against the truth",
        (
            "In demonstrations only: the distance of the simulated machine's tool from its "
            "intended position, which is known exactly because the machine is simulated. If the "
            "tracker measures this distance, it includes noise."
        ),
    ),
    (
        "gain",
        (
            "Share of the avoidable error (in squares) that disappears with a cause in the model, "
            "with its 95 % interval. Avoidable is the part of the held-out error without the "
            "cause that exceeds the noise."
        ),
    ),
    (
        "chi square per degree of freedom",
        (
            "Mean square of the residuals in units of their noise. About 1 if a model leaves "
            "nothing but noise; far above 1 the model is incomplete."
        ),
    ),
    (
        "signal λ (lambda)",
        (
            "Sum over all readings of the squared size of an effect in units of the noise, after "
            "removing everything that geometry and frame can imitate. From about 40 a cause is "
            "detected, from 80 to 160 it can be named."
        ),
    ),
    (
        "confidence",
        (
            "Probability that the name of a finding is right, against its rivals. It is never "
            "stated above 98 %, because an unknown cause may have the same effect as a known one."
        ),
    ),
    (
        "±",
        (
            "Standard deviation (k = 1) of the value before it, unless an interval of 95 % is "
            "named. On the console it is written +-. A certificate states U instead: k = 2 for "
            "dimensions, 95 % for positions. Where no value stands before it (RD of ISO 9283, "
            "the height of a shape), it is a deviation to either side."
        ),
    ),
    (
        "p",
        (
            "Probability of an equally strong signal by chance, multiplied by the number of "
            "questions and shapes tried."
        ),
    ),
    (
        "class",
        (
            "Causes that change the readings of this session in the same way. The named cause "
            'stands for all of them; the others follow after "or", with the measurement that '
            "would separate them."
        ),
    ),
    (
        "unknown structure",
        "The part of the remaining error that is not noise and fits no cause of the catalogue.",
    ),
    (
        "repeatability",
        (
            "Standard deviation of the rest position of a joint about its command. It is part of "
            "the noise of a pose. The RP of ISO 9283 is a different figure, for the tool."
        ),
    ),
    (
        "rank",
        (
            "Number of parameter combinations that the data determine. The others are "
            "determined by their tolerances alone, and no prediction depends on them."
        ),
    ),
    (
        "region",
        (
            "Convex hull of the places that were measured. Nothing is known about the machine "
            "outside. There corrections fade out over the margin in the robot file "
            "(limits.region_margin_mm), or end at the edge if the margin is zero."
        ),
    ),
    (
        "tolerance, prior",
        "Standard deviation by which a part may differ from its drawing, from the robot file.",
    ),
    (
        "seed",
        (
            "Seed of the random numbers. In a diagnosis or fit it determines the random parts and "
            "bootstraps; in a simulated session it determines the machine, its errors and the "
            "noise."
        ),
    ),
)


def glossary_section() -> Section:
    """Section with the glossary, at the end of a page."""
    table = Table(GLOSSARY, "", ("word", "meaning"), TERMS, words=(0, 1))
    return Section(GLOSSARY, "What the words mean", (), (table,))
