"""Trees read from and written to text, BehaviorTree.CPP XML, files and py_trees."""
