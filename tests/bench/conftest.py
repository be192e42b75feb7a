collect_ignore_glob = ["*.py"]  # benches are programs; none of their numbers is a test
