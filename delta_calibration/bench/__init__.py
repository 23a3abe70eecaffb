"""The `delta-cal serve` page: upload sessions, answer the check, download verdict and certificate.

The bench calculates nothing. Every step of its work is a verb of `delta-cal`, run as a child
process with the options that the page was given, in a folder of its own (`flow.py` says which verb
comes when). The folder is all the state there is: what a closed page, a second browser or a server
that was started again sees is read from it.

`cases.py` keeps the folders, `runner.py` runs the verbs, `upload.py` takes in what was dropped,
`guard.py` says who may ask at all, `pages.py` and `forms.py` answer, `cell.py` watches a running
cell.
"""
