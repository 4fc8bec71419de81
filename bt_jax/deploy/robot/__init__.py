"""What a robot is: a table of its arms, their joints, shapes and grippers, and the models that are made from it."""
