"""The small models that we trained ourselves and ship: see the .md beside each, and training/ for how they are made."""
