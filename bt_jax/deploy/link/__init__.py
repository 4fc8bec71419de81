"""The link to the controller: 250 Hz setpoints, the checks that every one of them passes, start and stop."""
