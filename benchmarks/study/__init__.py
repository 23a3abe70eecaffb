"""The diagnosis put on trial: sessions that hide something, made and judged in thousands.

    make study                                     a cluster of this machine's processes
    make study STUDY_ARGS="--scheduler tcp://host:8786"   a cluster that is there already

Every trial is one machine with one session, drawn from a seed, by a generator that shares no code
with the detector. A trial's outcome is one line of JSON; a study that was cut off goes on where it
was. What a trial hides is scaled to a wanted lambda: the squared size of what a calibration leaves
of the cause, in standard deviations of the noise, summed over the session.
"""
