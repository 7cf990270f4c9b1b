"""A fit as a piece of work: what is read, which model, with which settings; one after the other or on all cores."""
