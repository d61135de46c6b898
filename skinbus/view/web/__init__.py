"""The arm in 3-D, as a web page: a pure core that says what is drawn, and a shell that has viser draw it."""
