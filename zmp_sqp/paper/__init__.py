"""Song & Sharf 2020 beside our results."""
