"""Every sentence that rsgen says about a result.

Most stand in ``findings.toml``; those with more logic are functions in ``sentences``.

The numerical layers make findings (``rsgen.common.finding``); pages, notebooks, ``result.json`` and the
command line take their sentences from here. Nothing reads a sentence back.
"""
