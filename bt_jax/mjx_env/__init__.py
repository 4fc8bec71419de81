"""Boxes, tables and a kit in MuJoCo: states, what behaviors return in them, skills, physics, episodes and pictures.

Positions are metres in the world frame, quaternions wxyz as in MuJoCo, angles radians. Dimensions in the types of arrays:

    S  states or settling problems of a batch      P  trees of a population
    B  boxes of the task                           K  layouts of a tree
    F  frames of the task: boxes, kit, robot       E  episodes, P * K of them
    G  subgoals of the task                        V  tokens of the vocabulary
    M  surfaces                                    A  atoms: conditions, then actions
    C  commands: the actions that can be run       W  lanes of MJX

From the bottom: `world`, `semantics`, `scene`, `skills`, `physics`, `episodes`, `render`; each uses only those before it.
"""

from bt_jax._util.lazy import lazy_face

__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)
