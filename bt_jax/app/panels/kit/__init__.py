"""What step 1 is made of: the start screen, what there is, where it should be and where it starts, and what is wrong."""
