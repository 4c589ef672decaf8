"""What answers are worth: rates, calibration, targets, tables and figures."""
