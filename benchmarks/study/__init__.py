"""Study of the diagnosis: thousands of sessions with something hidden, diagnosed and evaluated.

    make study                                     a cluster of this machine's processes
    make study STUDY_ARGS="--scheduler tcp://host:8786"   a cluster that is there already

Every trial is one machine with one session, drawn from a seed by a generator that shares no code
with the detector. The outcome of a trial is one line of JSON; an interrupted study continues where
it stopped. Hidden causes are scaled to a wanted lambda: the squared size of what a calibration
leaves of the cause, in standard deviations of the noise, summed over the session.
"""
