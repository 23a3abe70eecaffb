"""A Delta of bodies in a physics engine (MuJoCo), and sessions measured on it.

Motors, arms, rods on ball joints and a platform, with their masses; what is hidden is hidden as a
spring, a gap, friction, a worn joint or a soft mount, and does what the engine makes of it. No
code of mechanisms, effects or models is shared with the package: only its file format is.
"""
