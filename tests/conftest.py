"""Options of the whole suite."""


def pytest_addoption(parser):
    parser.addoption("--figures", help="file that what the fault tests measure is written to")
    parser.addoption("--rows", help="only rows of the fault table with these words in their name")
