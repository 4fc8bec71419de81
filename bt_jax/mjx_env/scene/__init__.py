"""What stands where: the MuJoCo model of a task, random layouts, places on surfaces."""
