"""Every number that a verdict turns on, with what sets it.

Four kinds: conventions of statistics, priors, what was set on machines of development seeds (never
on those that judge), and effort, more of which finds the same. Tolerances of the numerics stand
where they are used; figures of proposed measurements in `proposals.py`.
"""

# Conventions of statistics. lambda is the squared length of a signal in standard deviations of the
# noise, beside all that is fitted anyway.
ALPHA = 0.002  # convention: chance that a session of a machine without a fault raises any alarm
SURE_QUANTILE = 0.025  # convention: a 95 % interval begins at this quantile
PLAIN = 3.0  # Kass and Raftery 1995: ln B from which evidence is strong
NAMED = 80.0  # power of the test: lambda from which a cause can be told from its neighbours
HIDDEN = 20.0  # power of the test: lambda under which a cause is mostly not even detected
SAME = 0.95  # convention: cosine beyond which two explanations are one class
# chi square with one degree of freedom, p = 8e-6: two explanations told apart for sure
SEPARATED = 20.0
CLEAR = 3.0  # three standard deviations: chi square beyond what noise accounts for
CHI3_MEDIAN = 1.538172  # median of the norm of three standard normal numbers
EULER = 0.5772  # Euler's constant: mean of the largest of many tries (Gumbel)
GROSS = 12.0  # standard deviations beyond which a reading is no noise, whatever its distribution
SPIKE = 6.0  # the same of a reading held against its neighbours on a path

# Priors
# a cause's size is flat in its logarithm over three decades of sizes that machines have
DECADES = 1000.0
NAMELESS = 0.05  # of what acts as a cause of the catalogue does, so much has no name
COMPLETE = 0.95  # of structure with the likeliest law of the grammar, so much follows it
PLAIN_WORDS = 4.0  # odds of a straight line against another function, of one quantity against two
USUAL = 1000.0  # odds of what moves a stage on machines against what does not, as far as known
# [m] by which a law with values of typical size moves the reading
TYPICAL_SHIFT = 1e-4
# odds that a name beside which a map explains some is a part of what the map is
PART_OF_A_MAP = 0.5

# Set on machines of development seeds, none of which judges (docs/diagnosis_study.md)
SLIGHT = 0.05  # share of the noise at rest that structure must exceed to matter
SLIGHT_MOVING = 0.15  # the same in motion, where no model of friction and loads is perfect
WORTH = 0.2  # share of the avoidable error that a map must take away on held-out data
FORETOLD = 0.25  # share of what a cause explains that it must foretell of held-out data
LAW_FORETOLD = 0.5  # the same of a law
LEAST_SURE = 0.05  # confidence under which a cause is not told
MOST_OF = 0.5  # share of what geometry explains that one dimension must, to be named
# times the tolerances by which all dimensions scatter, for `geometry` to be a finding
BEYOND = 1.5
ELSEWHERE = 1e-5  # p from which a reflector's place is a finding: its prior is no tolerance
NAMING = 25.0  # lambda at which a name is 63 % as sure as it can become
SHADOW = 0.9  # share of what a map explains that a named cause must explain to be preferred
SHADOWED = 0.5  # share of a cause's signal that a map makes as well, for it to be in its shadow
KNOWN = 0.98  # most that a name is sure: of 196 names stated with 0.95 all were of the class
REMAINS = 0.25  # share of what remains unexplained that a cause must explain at least
# share of what a cause explains that a map may explain beside it, or in its place: no model is
# perfect
SOME = 0.02
# the same of a map that chance may have made, on machines that others measured as well
MUCH = 0.1
IMPERFECT = 2e-3  # share of what a model explains that it may get wrong itself
LIKELIER = 0.9  # probability of a law from which causes that it follows as well are not named
TEMPER = 3.0  # ln p of laws is divided by this: calibrates their stated probability
LAW_SURE = 0.6  # probability from which a law is told
LAW_ALIKE = 0.98  # share of a signal that another law makes as well, for the two to be one
LAW_BESIDE = 0.1  # share of a law's ln B that a map may have beside it
MODELLED = 0.03  # share by which a law's ln B must exceed that of causes, to put them in doubt
LAW_SHOWS = 10.0  # ln B under which no law is looked for further
QUIETER = 0.8  # of the noise before, from which a smaller one is worth another search
ANOTHER = 55.0  # lambda that one more cause must have beside those that are found
LACKING = 1.1  # misfit from which a model may lack a strong cause
# standard deviations off its place in the file, from which the reflector may have been drawn away
STRAYED = 1.0
# of chi square by which readings in motion must favour the reflector's place in the file
OTHER_FLOOR = 6.0
FAIR = 0.1  # share of the information on a cause that poses at rest must hold to fit it there
MOVING = 0.25  # a signal at rest this small beside the one in motion shows in motion only
LEARNABLE = 0.2  # share of the information that must be left to learn from, of data held out
EXCEPTION = 0.3  # share of the poses under which stops on the way of a motion are left out

# Effort: more finds the same, later
MOST = 4  # causes at a time
SHORT_LIST = 30  # explanations that exchanges and pairs are made of
RIVAL = 0.25  # share of a map's ln B from which a cause is fitted in its place
NEARLY = 0.8  # share of a cause's ln B from which another is fitted in its place
LOOKED_AT = 3  # such others, at most
SWAPS = 2  # rounds of exchanges, at most
PARTS = 5  # into which data are divided for cross-validation
COMPARED_LAWS = 40  # laws that are held against one another
