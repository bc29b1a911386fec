"""Values from which a fit descends: equations linear in most parameters, a search in the others."""
