"""Constants of the search and of the verdict, with their origin.

Four kinds: conventions of statistics; priors; constants set on machines of development seeds
(never on those used to judge); and effort, where more finds the same. Numerical tolerances stand
where they are used; constants of the noise, of single effects, of the grammar of laws and of
proposed measurements in the files of these.
"""

# Conventions of statistics. lambda is the squared length of a signal in standard deviations of the
# noise, after projecting out all parameters that are fitted anyway.
ALPHA = 0.002  # convention: probability of any false alarm in a session of a fault-free machine
SURE_QUANTILE = 0.025  # convention: a 95 % interval begins at this quantile
PLAIN = 3.0  # Kass and Raftery 1995: ln B from which evidence is strong
NAMED = 80.0  # power of the test: lambda from which similar causes can be distinguished
HIDDEN = 20.0  # power of the test: lambda below which a cause is mostly not even detected
SAME = 0.95  # convention: cosine above which two candidates are one class
# chi square with one degree of freedom, p = 8e-6: two candidates are certainly distinguishable
SEPARATED = 20.0
CLEAR = 3.0  # standard deviations of the noise by which chi square must exceed its expectation
CHI3_MEDIAN = 1.538172  # median of the norm of three standard normal numbers
EULER = 0.5772  # Euler's constant: mean of the largest of many tries (Gumbel)
RISE = 1.96**2  # convention: rise of chi square at the ends of a 95 % interval of one parameter
GROSS = 12.0  # standard deviations beyond which no noise distribution accounts for a reading
SPIKE = 6.0  # the same for a reading compared with its neighbours on a path

# Priors
# the prior of a cause's size is uniform in its logarithm over three decades found on machines
DECADES = 1000.0
NAMELESS = 0.05  # share of errors that look like a cause of the catalogue but have no name in it
COMPLETE = 0.95  # probability that structure really follows its likeliest law of the grammar
# prior odds of an effect's plain shape, without searched fields, against all its searched ones
PLAINLY = 4.0
PLAIN_WORDS = 4.0  # prior odds of a line against another function, of one quantity against two
USUAL = 1000.0  # prior odds of a quantity known to move a stage of machines against another
# [m] by which a law with values of typical size moves the reading
TYPICAL_SHIFT = 1e-4
# factor on the confidence in a name, if a map beside it shows that it may be a part of the map
PART_OF_A_MAP = 0.5
# the same if the cause sets in when the payload changes, which explains it as well
WITH_PAYLOAD = 0.5

# Set on machines of development seeds, none of which is used to judge (docs/diagnosis_study.md)
SLIGHT = 0.05  # structure smaller than this share of the noise at rest does not matter
SLIGHT_MOVING = 0.15  # the same in motion, where no model of friction and loads is perfect
WORTH = 0.2  # least share of the avoidable held-out error that a map must remove (lower limit)
FORETOLD = 0.25  # least share of what a cause explains that it must also predict on held-out data
LAW_FORETOLD = 0.5  # the same for a law
LEAST_SURE = 0.05  # confidence below which a cause is not reported
MUCH_OF = 0.25  # share of what geometry explains that one dimension must, to be named
# scatter of all dimensions, in tolerances, from which `geometry` is a finding
BEYOND = 1.5
ELSEWHERE = 1e-5  # p below which the reflector's offset is a finding: its prior is no tolerance
NAMING = 12.0  # lambda at which the confidence in a name reaches 63 % of its maximum
SHADOW = 0.9  # share of what a map explains that a named cause must explain to be preferred
SHADOWED = 0.5  # share of a cause's signal that a map also follows, above which a map may hide it
KNOWN = 0.98  # maximum confidence in a name: of 196 stated with 0.95, all were of the class
REMAINS = 0.25  # least share of the unexplained remainder that a cause must explain
# share of what a cause explains up to which a map beside it, or in its place, is tolerated: no
# model is perfect
SOME = 0.02
# the same for a map that may be due to chance, on machines that others measured as well
MUCH = 0.1
SCATTERS = 2.5  # ratio of estimated to filed noise from which a warning is given
NEIGHBOURS = 0.05  # share of the poses whose errors together say where a map is largest
IMPERFECT = 2e-3  # share of what a model explains that may be its own error
# share of what is left above noise that no such error is: made by a cause of another kind
NEARLY_ALL = 0.9
LIKELIER = 0.5  # probability of a law from which causes that it also explains are not named
TEMPER = 3.0  # ln p of laws is divided by this: calibrates their stated probability
LAW_SURE = 0.6  # probability from which a law is reported
LAW_ALIKE = 0.98  # share of a signal that another law also follows, above which both are one class
LAW_BESIDE = 0.1  # largest ln B of a map beside a law, as a share of the law's ln B
# share by which a law's ln B must exceed that of the strongest cause to doubt it, if that is named
# alone or acts on the same stage
MODELLED = 0.03
# least share that a law must explain of the chi square above `LACKING`; the six right laws of
# test_found_law.py explained 0.949 or more of what exceeds the noise
LAW_EXPLAINS = 0.9
LAW_SHOWS = 10.0  # ln B below which the search for a law ends
QUIETER = 0.8  # share of the previous noise from which a lower noise is worth another search
ANOTHER = 55.0  # least lambda of one more cause beside those found
LACKING = 1.1  # chi square per degree of freedom above which a strong cause may be missing
# standard deviations of the prior from which the reflector's offset may be biased by a cause
STRAYED = 1.0
# decrease of chi square from which the reflector's offset of the robot file is preferred
OTHER_FLOOR = 6.0
FAIR = 0.1  # least share of the information on a parameter at rest, to fit it to the poses
MOVING = 0.25  # ratio of the signal at rest to that in motion, below which it shows in motion only
LEARNABLE = 0.2  # least share of the information that must remain when a part is held out
SAME_WAY = 0.5  # cosine of an outlier's residual with its neighbours', from which it is like them
LARGE = 3.0  # times the median residual of outliers, beyond which one is unlike the others
EXCEPTION = 0.3  # stops within a motion are left out if they are less than this share of the poses

# Effort: larger values find the same, but take longer
MOST = 4  # largest number of causes in a model
SHORT_LIST = 30  # candidates from which swaps and pairs are made
RIVAL = 0.25  # share of a map's ln B from which a cause is fitted in its place
NEARLY = 0.8  # share of a cause's ln B from which another is fitted in its place
KINDRED = 0.5  # share of a cause's signal from which another is compared in its best shape
LOOKED_AT = 3  # largest number of such alternatives
SWAPS = 2  # largest number of rounds of swaps
LOST = 20.0  # ln of the likelihood below the best from which a set is fitted in one round only
PARTS = 5  # into which data are divided for cross-validation
COMPARED_LAWS = 40  # laws that are compared with one another
