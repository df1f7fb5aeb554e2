"""How good a policy is: fixed balls, lines of episodes, policies that need no learning."""
