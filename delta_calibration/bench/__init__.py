"""The `delta-cal serve` page: upload sessions, answer the check, download verdict and certificate.

The bench calculates nothing. Every step of its work is a verb of `delta-cal`, run as a child
process with the options that the user gave on the page, in the folder of its case (`flow.py`
defines the order of the verbs). The folder is the only state: a reopened page, a second browser
and a restarted server all read it.

`cases.py` keeps the folders, `runner.py` runs the verbs, `upload.py` stores dropped files,
`guard.py` checks every request, `pages.py` and `forms.py` answer it, `cell.py` watches a running
cell.
"""
