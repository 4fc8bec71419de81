"""Where released boxes come to rest: C MuJoCo, MJX and the kinematic level behind one protocol."""
