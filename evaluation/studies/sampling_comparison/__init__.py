"""Sampling by what a database knows: the methods of thesis chapter 7 beside ours."""
