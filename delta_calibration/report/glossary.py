"""The words of all outputs, each with one meaning; `docs/glossary.md` says the same."""

from __future__ import annotations

from delta_calibration.report.document import Section, Table

GLOSSARY = "glossary"  # name of its section and table

TERMS: tuple[tuple[str, str], ...] = (
    (
        "before, calibrated, extended",
        "Three models of the machine: as drawn, or as the calibration in force has it, where it "
        "fits best; with its geometry identified; with the causes that were found as well. The "
        "tracker's frame and the reflector's offset are fitted in all three: where they are is "
        "no error of the machine. No model is extended by what predicts held-out poses worse.",
    ),
    (
        "pose, place, reading, stop",
        "A reading is one message of the tracker. A pose is a still moment: the mean of its "
        "readings. Poses of equal commands share a place. A stop is what a plan asks for; the "
        "ends of its paths are still moments too, so that a session has more poses than its "
        "plan stops.",
    ),
    (
        "noise of a pose",
        "Root mean square of the 3-D distance by which a pose misses the truth through the "
        "tracker and through where the joints come to rest; from repeats, or the robot file's "
        "where there are too few. A model that leaves about as much has nothing left to explain. "
        "Where repeats differ by a strong cause as well, a fit finds it too large; a diagnosis "
        "measures it again without the causes that it found. Also called noise floor.",
    ),
    (
        "in sample",
        "Root mean square 3-D distance between measured and predicted at the poses that the "
        "fit was made from. Says little: a fit bends to what it has seen.",
    ),
    (
        "held out",
        "Predicted by a fit that has not seen it. Two figures come of it: the error left of a "
        "fit and the held-out error of a diagnosis.",
    ),
    (
        "error left",
        "Of a fit and in a calibration file: root mean square 3-D distance between measured "
        "and predicted over the poses at rest that count, all alike. The places are parted in "
        "five by lot, and each part is predicted by a fit to the other four: what is left "
        "between the places that were measured.",
    ),
    (
        "held-out error",
        "Of a diagnosis, its verdict and its report: the same distance over the same poses, "
        "but whole sectors of the workspace are held out, five by the bearing about z. Larger "
        "than the error left, as a model has to foretell a region that it has not seen. Of "
        "one cause: of the model without it and with it beside all others; on readings in "
        "motion where it shows in motion only; of a smooth map, cells among others instead of "
        "sectors.",
    ),
    (
        "error against the truth",
        "Of demonstrations alone: how far the simulated machine's tool is from where the "
        "drawing means it to be, known as the machine is simulated. As measured by the "
        "tracker: with its noise.",
    ),
    (
        "gain",
        "Share of the avoidable error, in squares, that a cause takes away: avoidable is the "
        "held-out error without it beyond the noise. With its 95 % interval.",
    ),
    (
        "chi square per degree of freedom",
        "Mean square of the residuals in units of their noise. About 1 where a model leaves "
        "nothing but noise; far above it lacks something.",
    ),
    (
        "signal λ (lambda)",
        "Sum over all readings of the squared size of an effect in units of the noise, after "
        "all that geometry and frame can imitate is taken off. From about 40 a cause is seen, "
        "from 80 to 160 it can be named.",
    ),
    (
        "confidence",
        "Probability that the name of a finding is right, against its rivals. 95 % is the most "
        "that is said: what no catalogue knows may move the readings as a known cause does.",
    ),
    (
        "p",
        "Chance of as strong a signal where nothing is hidden, times all that was asked and "
        "tried.",
    ),
    (
        "class",
        "Causes that move the readings of this session alike. The cause that is named stands "
        "for its class; the others follow it after an or, with the measurement that would "
        "part them.",
    ),
    (
        "unknown structure",
        "What is left, is not noise, and fits no cause of the catalogue.",
    ),
    (
        "repeatability",
        "How far from its command a joint comes to rest, one standard deviation. In the noise "
        "of a pose. ISO 9283's RP is another figure, of the tool.",
    ),
    (
        "rank",
        "How many combinations of parameters the data set; the others are set by their "
        "tolerances alone, and no prediction depends on them.",
    ),
    (
        "region",
        "Convex hull of the places that were measured. Corrections end at it: outside nothing "
        "is known of the machine.",
    ),
    (
        "tolerance, prior",
        "Standard deviation by which a part may differ from its drawing, from the robot file.",
    ),
    (
        "seed",
        "Number that all chance is drawn by. That of a diagnosis or fit decides its parts and "
        "bootstraps; that of a simulated session its machine, errors and noise.",
    ),
)


def glossary_section() -> Section:
    """The words at the end of a page."""
    table = Table(GLOSSARY, "", ("word", "meaning"), TERMS, words=(0, 1))
    return Section(GLOSSARY, "What the words mean", (), (table,))
