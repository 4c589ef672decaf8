"""Which trial to record next: possible trials, what each would show, and how much it tells of the cause."""
