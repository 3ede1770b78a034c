"""Parametric furniture without end: every class a function of a random generator, real sizes, metres, +x the front, z up."""
