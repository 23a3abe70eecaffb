"""A Delta of rigid bodies in a physics engine (MuJoCo), and sessions measured on it.

It has motors, arms, rods on ball joints and a platform, with their masses. A hidden fault is a
spring, a gap, friction, a worn joint or a soft mount, and its effect is computed by the engine. No
code of mechanisms, effects or models is shared with the package, only its file format.
"""
