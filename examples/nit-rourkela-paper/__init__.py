"""The paper's measured resonances as a campaign folder; ``rigtwin demo`` finds them by this package."""
