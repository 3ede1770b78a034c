"""Getting models ready for work: fetch, check, quantise, judge. For irsctl; the daemon imports nothing of it."""
